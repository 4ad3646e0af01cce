// The picture of the stage with its tools.
import { useSignal, useSignalEffect } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { lastOf } from "../core/format";
import type { Purpose } from "../core/protocol";
import type { GizmoMode } from "../view/gizmo";
import { Viewport } from "../view/viewport";
import { usePage } from "./context";
import { Icon, type IconName } from "./icons";
import { Refusal } from "./overview";

const MODES: { mode: GizmoMode | undefined; icon: IconName; label: string; key: string }[] = [
  { mode: undefined, icon: "select", label: "Select", key: "q" },
  { mode: "translate", icon: "translate", label: "Move", key: "w" },
  { mode: "rotate", icon: "rotate", label: "Rotate", key: "e" },
  { mode: "scale", icon: "scale", label: "Scale", key: "r" },
];
const PURPOSES: Purpose[] = ["render", "proxy", "guide"];

export function ViewportPanel(): JSX.Element {
  const page = usePage();
  const { session } = page;
  const host = useRef<HTMLDivElement>(null);
  const problem = useSignal("");

  useEffect(() => {
    const element = host.current;
    if (!element) return undefined;
    let viewport: Viewport;
    try {
      viewport = createViewport(page, element);
    } catch {
      problem.value =
        "This browser shows no 3D pictures: it has no WebGL 2, or it is switched off. Tree, properties, people and history work without it.";
      return undefined;
    }
    page.viewport.value = viewport;
    session.sceneArrived = (isReset, isComplete, isOther) => viewport.sceneArrived(isReset, isComplete, isOther);
    return () => {
      page.viewport.value = undefined;
      viewport.dispose();
    };
  }, []);
  useSignalEffect(() => page.viewport.value?.setUpAxis(session.welcome.value?.upAxis ?? "Y"));
  useSignalEffect(() => page.viewport.value?.setPeople(session.people.value));
  useSignalEffect(() => page.viewport.value?.setSelection(session.selection.value));
  useSignalEffect(() => page.viewport.value?.setTheme(page.theme.value === "dark"));
  useSignalEffect(() => page.viewport.value?.setGizmo(page.gizmo.value));
  useSignalEffect(() => page.viewport.value?.setPurposes(page.purposes.value));

  const followed = session.people.value.find(({ id }) => id === page.followed.value);
  const selected = session.selection.value.at(-1);
  return (
    <section class="viewport" aria-label="Viewport">
      <div ref={host} class="viewport-host" />
      {problem.value !== "" && <p class="viewport-problem">{problem.value}</p>}
      {problem.value === "" && <Toolbar />}
      {followed && (
        <div class="follow-frame" style={{ borderColor: followed.color }}>
          <span style={{ backgroundColor: followed.color }}>
            Following {followed.user}
            <button
              type="button"
              class="icon-button"
              aria-label="Stop following"
              onClick={() => page.follow(undefined)}
            >
              <Icon name="close" />
            </button>
          </span>
        </div>
      )}
      {page.stageCamera.value !== undefined && (
        <div class="stage-camera">
          <Icon name="camera" /> {lastOf(page.stageCamera.value)}
          <button type="button" class="small" onClick={() => page.lookThrough(undefined)}>
            Leave
          </button>
        </div>
      )}
      {selected !== undefined && page.gizmo.value !== undefined && (
        <div class="gizmo-refusal">
          <Refusal path={selected} />
        </div>
      )}
    </section>
  );
}

function createViewport(page: ReturnType<typeof usePage>, element: HTMLElement): Viewport {
  const { session } = page;
  let waiting: number[] | undefined;
  let path = "";
  let isBusy = false;
  // One preview is on its way at a time: a slow line gets fewer of them, and never old ones.
  const send = (): void => {
    if (isBusy || !waiting) return;
    const matrix = waiting;
    waiting = undefined;
    isBusy = true;
    void session.edit("transform", { path, matrix, commit: false }, path).finally(() => {
      isBusy = false;
      send();
    });
  };
  return new Viewport(element, session.store, {
    picked: (found, isAdded) => page.select(found, isAdded),
    cameraMoved: (matrix) => session.moveCamera(matrix),
    transformed: (moved, matrix, commit) => {
      path = moved;
      if (!commit) {
        session.draggedPath = moved;
        waiting = matrix;
        send();
        return;
      }
      waiting = undefined;
      void session.edit("transform", { path: moved, matrix, commit: true }, moved).finally(() => {
        session.draggedPath = "";
      });
    },
    navigated: () => {
      page.followed.value = undefined;
      page.stageCamera.value = undefined;
    },
  });
}

function Toolbar(): JSX.Element {
  const page = usePage();
  const { session } = page;
  // Counts items: the cameras are those of the scene that is here.
  const cameras = session.items.value > 0 ? [...session.store.items.values()].filter(({ camera }) => camera) : [];
  return (
    <div class="toolbar" role="toolbar" aria-label="Tools of the viewport">
      <div class="tool-group">
        {MODES.map(({ mode, icon, label, key }) => (
          <button
            type="button"
            key={label}
            class={`icon-button${page.gizmo.value === mode ? " on" : ""}`}
            aria-label={label}
            aria-pressed={page.gizmo.value === mode}
            title={
              mode && !session.mayEdit ? `${label}: you may not edit this project` : `${label} (${key.toUpperCase()})`
            }
            disabled={mode !== undefined && !session.mayEdit}
            onClick={() => {
              page.gizmo.value = mode;
            }}
          >
            <Icon name={icon} />
          </button>
        ))}
      </div>
      <div class="tool-group">
        <button
          type="button"
          class="icon-button"
          aria-label="Frame the selection"
          title="Frame the selection, or everything (F)"
          onClick={() => page.viewport.value?.frameOn(session.selection.value)}
        >
          <Icon name="frame" />
        </button>
        {cameras.length > 0 && (
          <select
            aria-label="Camera"
            value={page.stageCamera.value ?? ""}
            onChange={(event) => page.lookThrough(event.currentTarget.value || undefined)}
          >
            <option value="">Free camera</option>
            {cameras.map(({ path }) => (
              <option key={path} value={path}>
                {lastOf(path)}
              </option>
            ))}
          </select>
        )}
        <details class="menu">
          <summary class="icon-button" aria-label="What is shown" title="What is shown">
            <Icon name="eye" />
          </summary>
          <div class="menu-content">
            {PURPOSES.map((purpose) => (
              <label key={purpose}>
                <input
                  type="checkbox"
                  checked={page.purposes.value.has(purpose)}
                  onChange={(event) => {
                    const purposes = new Set(page.purposes.value);
                    if (event.currentTarget.checked) purposes.add(purpose);
                    else purposes.delete(purpose);
                    page.purposes.value = purposes;
                  }}
                />{" "}
                {purpose} purpose
              </label>
            ))}
          </div>
        </details>
      </div>
      {session.mayEdit && (
        <div class="tool-group">
          <UndoButton type="undo" label="Undo" keys="Ctrl+Z" />
          <UndoButton type="redo" label="Redo" keys="Ctrl+Shift+Z" />
        </div>
      )}
    </div>
  );
}

function UndoButton({ type, label, keys }: { type: "undo" | "redo"; label: string; keys: string }): JSX.Element {
  const page = usePage();
  return (
    <button
      type="button"
      class="icon-button"
      aria-label={label}
      title={`${label} your own edit (${keys})`}
      onClick={() => void undo(page, type)}
    >
      <Icon name={type} />
    </button>
  );
}

/** Takes the person's own newest edit back, or makes it again. */
export async function undo(page: ReturnType<typeof usePage>, type: "undo" | "redo"): Promise<void> {
  const { session } = page;
  try {
    const answer = (await session.ask(type)) as { done?: boolean; message?: string } | null;
    if (answer?.message) session.notify(answer.message);
    else if (answer?.done === false) session.notify(`There is nothing to ${type}.`);
  } catch (error) {
    session.notify(error instanceof Error ? error.message : String(error));
  }
}

/** The time of the stage: a slider over its time codes. */
export function TimeBar(): JSX.Element | null {
  const page = usePage();
  const { session } = page;
  const wish = useSignal<number | undefined>(undefined);
  const isPlaying = useSignal(false);
  const welcome = session.welcome.value;
  const start = welcome?.startTime ?? 0;
  const end = welcome?.endTime ?? 0;
  const rate = welcome?.timeCodesPerSecond || 24;
  const time = wish.value ?? session.state.value?.time ?? start;

  useEffect(() => {
    if (wish.value === undefined) return undefined;
    const sent = wish.value;
    const timer = setTimeout(() => {
      void session.edit("time", { time: sent }, "").finally(() => {
        if (wish.value === sent && !isPlaying.value) wish.value = undefined;
      });
    }, 40);
    return () => clearTimeout(timer);
  }, [wish.value]);
  useEffect(() => {
    if (!isPlaying.value) return undefined;
    let last = performance.now();
    const timer = setInterval(() => {
      const now = performance.now();
      const next = (wish.value ?? time) + ((now - last) / 1000) * rate;
      last = now;
      wish.value = next > end ? start : next;
    }, 1000 / 30);
    return () => clearInterval(timer);
  }, [isPlaying.value]);

  // A stage with a range of times has no pose at its default time: the first viewer begins at the start.
  const isAtDefault = welcome !== undefined && welcome.time === null && session.state.value?.time == null;
  useEffect(() => {
    if (isAtDefault && end > start) void session.edit("time", { time: start }, "");
  }, [isAtDefault, welcome?.stage, start, end]);

  if (!(end > start)) return null;
  return (
    <section class="time-bar" aria-label="Time of the stage">
      <button
        type="button"
        class="icon-button"
        aria-label={isPlaying.value ? "Pause" : "Play"}
        onClick={() => {
          isPlaying.value = !isPlaying.value;
        }}
      >
        <Icon name={isPlaying.value ? "pause" : "play"} filled />
      </button>
      <span class="weak number">{start}</span>
      <input
        type="range"
        aria-label="Time code"
        min={start}
        max={end}
        step="any"
        value={time}
        onInput={(event) => {
          wish.value = Number(event.currentTarget.value);
        }}
      />
      <span class="weak number">{end}</span>
      <output class="number time-now">{time.toFixed(1)}</output>
    </section>
  );
}

/** Keys that work everywhere but in a field. */
export function pressed(page: ReturnType<typeof usePage>, event: KeyboardEvent): void {
  const target = event.target as HTMLElement;
  const isField =
    /^(INPUT|SELECT|TEXTAREA)$/.test(target.tagName) &&
    !["range", "checkbox"].includes((target as HTMLInputElement).type);
  if (isField) return;
  const isCommand = event.ctrlKey || event.metaKey;
  const key = event.key.toLowerCase();
  if (isCommand && (key === "z" || key === "y")) {
    event.preventDefault();
    if (page.session.mayEdit) void undo(page, key === "y" || event.shiftKey ? "redo" : "undo");
    return;
  }
  if (isCommand || event.altKey) return;
  const tool = MODES.find((one) => one.key === key);
  if (key === "f") page.viewport.value?.frameOn(page.session.selection.value);
  else if (key === "escape") {
    if (page.followed.value !== undefined) page.follow(undefined);
    else if (page.stageCamera.value !== undefined) page.lookThrough(undefined);
    else page.session.select([]);
  } else if (tool && (tool.mode === undefined || page.session.mayEdit)) page.gizmo.value = tool.mode;
  else return;
  event.preventDefault();
}
