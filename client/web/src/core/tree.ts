// Holds the part of the prim tree that a person has opened, and loads children when they are needed.
import type { TreeEntry } from "./protocol";

export interface ChildPage {
  total: number;
  items: TreeEntry[];
}

export type Row =
  | { isLoaded: true; entry: TreeEntry; depth: number; isExpanded: boolean; position: number; siblings: number }
  | { isLoaded: false; parent: string; position: number; depth: number };

interface Node {
  total: number;
  items: (TreeEntry | undefined)[];
  loading: Set<number>;
  /** Pages that changed while they were loaded. */
  again: Set<number>;
}

const PAGE = 200;

export const parentOf = (path: string): string => path.slice(0, Math.max(1, path.lastIndexOf("/"))) || "/";

/** Rows of a virtual list. Loading never blocks: rows that are not here are gaps until they arrive. */
export class TreeModel {
  private readonly nodes = new Map<string, Node>();
  private readonly expanded = new Set<string>(["/"]);
  private cached: Row[] | undefined;
  private generation = 0;
  problem = "";

  constructor(
    private readonly load: (path: string, from: number, count: number) => Promise<ChildPage>,
    private readonly changed: () => void,
  ) {}

  get rows(): Row[] {
    if (!this.cached) {
      this.cached = [];
      this.addRows("/", 0, this.cached, new Set());
    }
    return this.cached;
  }

  /** Begins with the first children, again after a reload. What was expanded stays so. */
  reset(): void {
    this.generation++;
    this.nodes.clear();
    this.cached = undefined;
    for (const path of this.expanded) void this.loadPage(path, 0);
    this.changed();
  }

  /** Loads what is missing between two rows. */
  need(first: number, last: number): void {
    for (const row of this.rows.slice(first, last + 1)) {
      if (!row.isLoaded) void this.loadPage(row.parent, Math.floor(row.position / PAGE));
    }
  }

  expand(path: string): void {
    this.expanded.add(path);
    if (!this.nodes.has(path)) void this.loadPage(path, 0);
    this.update();
  }

  collapse(path: string): void {
    this.expanded.delete(path);
    this.update();
  }

  isExpanded(path: string): boolean {
    return this.expanded.has(path);
  }

  /** Loads and expands the ancestors; returns the row of the prim, or -1 if it is not in the tree. */
  async reveal(path: string): Promise<number> {
    const ancestors: string[] = [];
    for (let at = parentOf(path); at !== "/"; at = parentOf(at)) ancestors.unshift(at);
    for (const ancestor of ["/", ...ancestors]) {
      this.expanded.add(ancestor);
      if (!this.nodes.has(ancestor)) await this.loadPage(ancestor, 0);
    }
    const node = this.nodes.get(parentOf(path));
    for (let page = 0; node && page * PAGE < node.total; page++) {
      if (node.items.some((entry) => entry?.path === path)) break;
      await this.loadPage(parentOf(path), page);
    }
    this.update();
    return this.rowOf(path);
  }

  rowOf(path: string): number {
    return this.rows.findIndex((row) => row.isLoaded && row.entry.path === path);
  }

  /** Loads again what may differ. The old rows stay until the answers arrive. */
  invalidate(paths: string[], isStructure: boolean, isAll: boolean): void {
    const parents = new Set<string>();
    if (isAll) for (const path of this.nodes.keys()) parents.add(path);
    for (const path of paths) {
      const parent = parentOf(path);
      if (this.nodes.has(parent)) parents.add(parent);
      if (isStructure && this.nodes.has(path)) parents.add(path);
    }
    for (const parent of parents) {
      const node = this.nodes.get(parent);
      if (!node) continue;
      const pages = new Set<number>([0]);
      node.items.forEach((entry, index) => {
        if (entry) pages.add(Math.floor(index / PAGE));
      });
      for (const page of pages) void this.loadPage(parent, page, true);
    }
  }

  private async loadPage(path: string, page: number, again = false): Promise<void> {
    const node = this.nodes.get(path) ?? { total: 0, items: [], loading: new Set<number>(), again: new Set<number>() };
    if (node.loading.has(page)) {
      if (again) node.again.add(page);
      return;
    }
    if (!again && node.items[page * PAGE] !== undefined) return;
    this.nodes.set(path, node);
    node.loading.add(page);
    const { generation } = this;
    try {
      const { total, items } = await this.load(path, page * PAGE, PAGE);
      if (generation !== this.generation) return;
      if (total === 0 && path !== "/") this.nodes.delete(path);
      node.total = total;
      node.items.length = Math.min(node.items.length, total);
      items.forEach((entry, index) => {
        node.items[page * PAGE + index] = entry;
      });
      this.problem = "";
    } catch (error) {
      if (generation !== this.generation) return;
      this.problem = error instanceof Error ? error.message : String(error);
      if (node.items.length === 0 && path !== "/") this.nodes.delete(path);
    } finally {
      node.loading.delete(page);
    }
    this.update();
    if (node.again.delete(page)) await this.loadPage(path, page, true);
  }

  private update(): void {
    this.cached = undefined;
    this.changed();
  }

  private addRows(path: string, depth: number, rows: Row[], above: Set<string>): void {
    const node = this.nodes.get(path);
    if (!node || above.has(path)) return;
    above.add(path);
    for (let position = 0; position < node.total; position++) {
      const entry = node.items[position];
      if (!entry) {
        rows.push({ isLoaded: false, parent: path, position, depth });
        continue;
      }
      const isExpanded = entry.children > 0 && this.expanded.has(entry.path);
      rows.push({ isLoaded: true, entry, depth, isExpanded, position, siblings: node.total });
      if (isExpanded) this.addRows(entry.path, depth + 1, rows, above);
    }
    above.delete(path);
  }
}
