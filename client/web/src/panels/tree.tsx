// The tree of prims: virtual, loaded on demand, with search, for mouse and keyboard as the ARIA tree pattern wants it.
import { useSignal, useSignalEffect } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useMemo, useRef } from "preact/hooks";
import type { TreeEntry } from "../core/protocol";
import { type ChildPage, parentOf, type Row, TreeModel } from "../core/tree";
import { textOf } from "../state/session";
import { usePage } from "./context";
import { Icon, iconOf } from "./icons";

const ROW_HEIGHT = 24;
const MARGIN_ROWS = 8;
const SEARCH_PAUSE_MS = 200;
const SEARCH_LIMIT = 200;

export function TreePanel(): JSX.Element {
  const page = usePage();
  const { session } = page;
  const version = useSignal(0);
  const search = useSignal("");
  const model = useMemo(
    () =>
      new TreeModel(
        async (path, from, count) => (await session.ask("children", { path, from, count })) as unknown as ChildPage,
        () => {
          // Reading it with `value` would make each effect that changes the tree run again.
          version.value = version.peek() + 1;
        },
      ),
    [session],
  );
  useSignalEffect(() => {
    if (session.resets.value > 0) model.reset();
  });
  useSignalEffect(() => {
    const changed = session.changed.value;
    if (changed) model.invalidate(changed.paths, changed.structure, changed.all === true);
  });
  return (
    <section class="panel tree-panel" aria-label="Prims">
      <h2>Prims</h2>
      <div class="search">
        <Icon name="search" />
        <input
          type="search"
          placeholder="Search prims"
          aria-label="Search prims"
          value={search.value}
          onInput={(event) => {
            search.value = event.currentTarget.value;
          }}
        />
      </div>
      {search.value.trim() === "" ? (
        <Tree model={model} version={version.value} />
      ) : (
        <Found text={search.value.trim()} />
      )}
    </section>
  );
}

function Tree({ model, version }: { model: TreeModel; version: number }): JSX.Element {
  const page = usePage();
  const { session } = page;
  const list = useRef<HTMLDivElement>(null);
  const top = useSignal(0);
  const height = useSignal(400);
  const focused = useSignal("");
  const { rows } = model;
  const first = Math.max(0, Math.floor(top.value / ROW_HEIGHT) - MARGIN_ROWS);
  const last = Math.min(rows.length - 1, Math.ceil((top.value + height.value) / ROW_HEIGHT) + MARGIN_ROWS);

  useEffect(() => model.need(first, last), [first, last, version]);
  useEffect(() => {
    const element = list.current;
    if (!element) return undefined;
    const observer = new ResizeObserver(() => {
      height.value = element.clientHeight;
    });
    observer.observe(element);
    return () => observer.disconnect();
  }, []);
  useSignalEffect(() => {
    const wish = page.revealed.value;
    if (wish) void model.reveal(wish.path).then((row) => show(row));
  });

  function show(row: number): void {
    const element = list.current;
    if (!element || row < 0) return;
    const at = row * ROW_HEIGHT;
    if (at < element.scrollTop) element.scrollTop = at;
    else if (at + ROW_HEIGHT > element.scrollTop + element.clientHeight)
      element.scrollTop = at + ROW_HEIGHT - element.clientHeight;
  }

  function go(row: number, isAdded: boolean): void {
    const target = rows[Math.max(0, Math.min(rows.length - 1, row))];
    if (!target?.isLoaded) return;
    focused.value = target.entry.path;
    page.select(target.entry.path, isAdded);
    show(row);
  }

  function pressed(event: KeyboardEvent): void {
    const at = Math.max(0, model.rowOf(focused.value || session.selection.value.at(-1) || ""));
    const row = rows[at];
    const step = Math.max(1, Math.floor(height.value / ROW_HEIGHT) - 1);
    const moves: Record<string, number> = {
      ArrowDown: at + 1,
      ArrowUp: at - 1,
      Home: 0,
      End: rows.length - 1,
      PageDown: at + step,
      PageUp: at - step,
    };
    const move = moves[event.key];
    if (move !== undefined) go(Math.max(0, Math.min(rows.length - 1, move)), event.shiftKey);
    else if (!row?.isLoaded) return;
    else if (event.key === "ArrowRight") {
      if (row.entry.children > 0 && !row.isExpanded) model.expand(row.entry.path);
      else if (row.isExpanded) go(at + 1, false);
    } else if (event.key === "ArrowLeft") {
      if (row.isExpanded) model.collapse(row.entry.path);
      else if (row.depth > 0) go(model.rowOf(parentOf(row.entry.path)), false);
    } else if (event.key === "Enter" || event.key === " ") go(at, event.ctrlKey);
    else return;
    event.preventDefault();
  }

  function clicked(event: MouseEvent): void {
    const path = pathAt(event);
    if (path === undefined) return;
    focused.value = path;
    list.current?.focus();
    if (!(event.target as Element).closest("[data-twist]"))
      page.select(path, event.ctrlKey || event.metaKey || event.shiftKey);
    else if (model.isExpanded(path)) model.collapse(path);
    else model.expand(path);
  }

  const active = focused.value || session.selection.value.at(-1) || "";
  return (
    <>
      {model.problem && <p class="empty bad">{model.problem}</p>}
      <div
        ref={list}
        class="tree"
        role="tree"
        aria-label="Prims of the stage"
        aria-multiselectable="true"
        aria-activedescendant={model.rowOf(active) >= 0 ? rowId(active) : undefined}
        tabIndex={0}
        onScroll={(event) => {
          top.value = event.currentTarget.scrollTop;
        }}
        onKeyDown={pressed}
        onClick={clicked}
        onDblClick={(event) => {
          const path = pathAt(event);
          if (path) page.viewport.value?.frameOn([path]);
        }}
      >
        <div class="tree-space" role="presentation" style={{ height: `${rows.length * ROW_HEIGHT}px` }}>
          {rows.slice(first, last + 1).map((row, index) => (
            <TreeRow
              key={row.isLoaded ? row.entry.path : `${row.parent}#${row.position}`}
              row={row}
              top={(first + index) * ROW_HEIGHT}
            />
          ))}
        </div>
      </div>
    </>
  );
}

/** The prim of the row in which a click happened. */
function pathAt(event: MouseEvent): string | undefined {
  return (event.target as Element).closest<HTMLElement>("[data-path]")?.dataset.path;
}

const rowId = (path: string) => `prim${path}`;

function TreeRow({ row, top }: { row: Row; top: number }): JSX.Element {
  const page = usePage();
  if (!row.isLoaded)
    return (
      <div
        class="tree-row gap"
        role="presentation"
        style={{ top: `${top}px`, paddingLeft: `${8 + 14 * row.depth}px` }}
      />
    );
  const { entry } = row;
  const selected = page.session.selection.value.includes(entry.path);
  const others = page.session.people.value.filter(({ selection }) => selection.includes(entry.path));
  return (
    <div
      id={rowId(entry.path)}
      class={`tree-row${selected ? " selected" : ""}${entry.active ? "" : " inactive"}`}
      role="treeitem"
      aria-level={row.depth + 1}
      aria-posinset={row.position + 1}
      aria-setsize={row.siblings}
      aria-expanded={entry.children > 0 ? row.isExpanded : undefined}
      aria-selected={selected}
      data-path={entry.path}
      style={{ top: `${top}px`, paddingLeft: `${4 + 14 * row.depth}px` }}
      tabIndex={-1}
    >
      <span class={`twist${entry.children > 0 ? "" : " none"}${row.isExpanded ? " open" : ""}`} data-twist>
        <Icon name="chevron" />
      </span>
      <EntryLabel entry={entry} />
      {others.map(({ id, user, color }) => (
        <span key={id} class="selected-by" style={{ backgroundColor: color }} title={`${user} has selected this`} />
      ))}
    </div>
  );
}

function EntryLabel({ entry }: { entry: TreeEntry }): JSX.Element {
  return (
    <>
      <Icon name={iconOf(entry.type, entry.instance)} />
      <span class="prim-name">{entry.name}</span>
      <span class="prim-type">{entry.type}</span>
      {entry.hasVariants && <span class="badge">V</span>}
      {!entry.loaded && <span class="badge">unloaded</span>}
    </>
  );
}

function Found({ text }: { text: string }): JSX.Element {
  const page = usePage();
  const found = useSignal<{ items: TreeEntry[]; more: boolean } | undefined>(undefined);
  const problem = useSignal("");
  useEffect(() => {
    let isOld = false;
    const timer = setTimeout(async () => {
      try {
        const answer = await page.session.ask("search", { text, limit: SEARCH_LIMIT });
        if (isOld) return;
        found.value = answer as unknown as { items: TreeEntry[]; more: boolean };
        problem.value = "";
      } catch (error) {
        if (!isOld) problem.value = textOf(error);
      }
    }, SEARCH_PAUSE_MS);
    return () => {
      isOld = true;
      clearTimeout(timer);
    };
  }, [text]);
  if (problem.value) return <p class="empty bad">{problem.value}</p>;
  if (!found.value) return <p class="empty">Searching …</p>;
  const { items, more } = found.value;
  return (
    <div class="found" role="listbox" aria-label="Found prims">
      {items.length === 0 && <p class="empty">No prim has this in its name or path.</p>}
      {items.map((entry) => (
        <button
          type="button"
          key={entry.path}
          role="option"
          aria-selected={page.session.selection.value.includes(entry.path)}
          class="found-row"
          title={entry.path}
          data-path={entry.path}
          onClick={() => page.select(entry.path, false)}
        >
          <EntryLabel entry={entry} />
        </button>
      ))}
      {more && <p class="empty">There are more than {SEARCH_LIMIT}; type more of the name.</p>}
    </div>
  );
}
