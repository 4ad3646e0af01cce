// Gives the panels what they share: the session, the settings of this browser, and the viewport.
import { signal } from "@preact/signals";
import { createContext } from "preact";
import { useContext } from "preact/hooks";
import type { Purpose } from "../core/protocol";
import type { Session } from "../state/session";
import type { GizmoMode } from "../view/gizmo";
import type { Viewport } from "../view/viewport";

export type Theme = "light" | "dark";
export type Tab = "properties" | "history" | "sessions" | "people" | "admin";
export type PhoneView = "viewport" | "overview" | "history" | "sessions";

export class Page {
  readonly tab = signal<Tab>("properties");
  readonly phoneView = signal<PhoneView>("viewport");
  readonly gizmo = signal<GizmoMode | undefined>(undefined);
  readonly followed = signal<string | undefined>(undefined);
  readonly stageCamera = signal<string | undefined>(undefined);
  readonly purposes = signal<ReadonlySet<Purpose>>(new Set<Purpose>(["default", "proxy"]));
  readonly theme = signal<Theme>(firstTheme());
  readonly viewport = signal<Viewport | undefined>(undefined);
  /** The prim of which the tree shows the row; a new object for each wish. */
  readonly revealed = signal<{ path: string } | undefined>(undefined);

  constructor(readonly session: Session) {
    this.theme.subscribe((theme) => {
      document.documentElement.dataset.theme = theme;
    });
  }

  toggleTheme(): void {
    this.theme.value = this.theme.value === "dark" ? "light" : "dark";
    store("usdlive.theme", this.theme.value);
  }

  select(path: string | undefined, isAdded: boolean): void {
    const { session } = this;
    if (path === undefined) {
      if (!isAdded) session.select([]);
      return;
    }
    const before = session.selection.value;
    if (!isAdded) session.select([path]);
    else session.select(before.includes(path) ? before.filter((one) => one !== path) : [...before, path]);
    this.revealed.value = { path };
  }

  follow(id: string | undefined): void {
    this.followed.value = id;
    this.stageCamera.value = undefined;
    this.viewport.value?.lookThrough(undefined);
    this.viewport.value?.follow(id);
  }

  lookThrough(path: string | undefined): void {
    this.followed.value = undefined;
    this.stageCamera.value = path;
    this.viewport.value?.follow(undefined);
    this.viewport.value?.lookThrough(path);
  }
}

function firstTheme(): Theme {
  const stored = storedValue("usdlive.theme");
  if (stored === "light" || stored === "dark") return stored;
  return matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
}

/** A browser that keeps nothing is no reason not to work. */
function store(key: string, value: string): void {
  try {
    localStorage.setItem(key, value);
  } catch {
    // The setting holds until the page is closed.
  }
}

function storedValue(key: string): string | null {
  try {
    return localStorage.getItem(key);
  } catch {
    return null;
  }
}

export const PageContext = createContext<Page | undefined>(undefined);

export function usePage(): Page {
  const page = useContext(PageContext);
  if (!page) throw new Error("a panel is outside of the page");
  return page;
}
