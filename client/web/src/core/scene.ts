// Holds what there is to draw: items by number, with their local and world matrices in flat arrays.
import { IDENTITY, isFiniteAffine, multiply } from "./affine";
import { type Batch, MATRIX_SIZE } from "./batch";
import type { Item, Material, PrimId, SceneMessage } from "./protocol";

export interface Instances {
  count: number;
  values: Float32Array;
  prototypes: Uint32Array;
}

/** The changes of the last calls. The viewport takes it once a frame. */
export interface SceneChanges {
  /** Items that came, went, or have to be drawn in another group: another geometry, material or visibility. */
  items: Set<PrimId>;
  moved: Set<PrimId>;
  colors: Set<PrimId>;
  materials: Set<string>;
  instances: Set<PrimId>;
  reset: boolean;
}

const noChanges = (): SceneChanges => ({
  items: new Set(),
  moved: new Set(),
  colors: new Set(),
  materials: new Set(),
  instances: new Set(),
  reset: false,
});

/**
 * A place for each item, and for each place the parent's place, so that a world matrix is one product. Moving an item
 * computes its subtree only. An item may come before its parent.
 */
export class SceneStore {
  readonly items = new Map<PrimId, Item>();
  readonly materials = new Map<string, Material>();
  readonly instances = new Map<PrimId, Instances>();
  private readonly byPath = new Map<string, PrimId>();
  private readonly places = new Map<PrimId, number>();
  private readonly children = new Map<PrimId, Set<PrimId>>();
  private readonly free: number[] = [];
  private local = new Float64Array(MATRIX_SIZE * 64);
  private worlds = new Float64Array(MATRIX_SIZE * 64);
  private shown = new Uint8Array(64);
  private used = 0;
  private changes = noChanges();

  /** Returns what changed since the last call, and forgets it. */
  takeChanges(): SceneChanges {
    const taken = this.changes;
    this.changes = noChanges();
    return taken;
  }

  get isChanged(): boolean {
    const { items, moved, colors, materials, instances, reset } = this.changes;
    return reset || items.size + moved.size + colors.size + materials.size + instances.size > 0;
  }

  applyScene(message: SceneMessage): void {
    if (message.reset) this.clear();
    for (const material of message.materials ?? []) {
      this.materials.set(material.hash, material);
      this.changes.materials.add(material.hash);
    }
    for (const id of message.remove ?? []) this.remove(id);
    const added = message.add ?? [];
    for (const item of added) this.put(item);
    for (const item of added) this.updateSubtree(item.id);
  }

  /**
   * Items that are not there are ignored: they were removed while the batch was on its way. The item `dragged` keeps its
   * matrix, which is newer than that of the batch.
   */
  applyBatch(batch: Batch, dragged?: PrimId): void {
    const moved = new Set<PrimId>();
    for (const { ids, values } of batch.matrices) {
      for (let index = 0; index < ids.length; index++) {
        const place = this.places.get(ids[index] as number);
        if (place === undefined || ids[index] === dragged) continue;
        this.setLocal(place, values, MATRIX_SIZE * index);
        moved.add(ids[index] as number);
      }
    }
    for (const id of moved) if (!this.hasMovedAncestor(id, moved)) this.updateSubtree(id, false);
    for (const { ids, visible } of batch.visibility) {
      for (let index = 0; index < ids.length; index++) this.setVisible(ids[index] as number, visible[index] !== 0);
    }
    for (const { ids, values } of batch.colors) {
      for (let index = 0; index < ids.length; index++)
        this.setColor(ids[index] as number, values.subarray(4 * index, 4 * index + 4));
    }
    for (const { ids, hashes } of batch.geometry) {
      for (let index = 0; index < ids.length; index++) {
        const item = this.items.get(ids[index] as number);
        if (!item) continue;
        item.geometry = hashes[index] as string;
        this.changes.items.add(item.id);
      }
    }
    for (const { id, count, values, prototypes } of batch.instances) {
      if (!this.items.has(id)) continue;
      // The arrays are copied, because the buffer of a batch is not kept.
      this.instances.set(id, { count, values: values.slice(), prototypes: prototypes.slice() });
      this.changes.instances.add(id);
    }
  }

  /** Sets the local matrix of one item, as an edit of this page does before the gateway answers. */
  move(id: PrimId, matrix: ArrayLike<number>): void {
    const place = this.places.get(id);
    if (place === undefined) return;
    this.setLocal(place, matrix, 0);
    this.updateSubtree(id, false);
  }

  idOf(path: string): PrimId | undefined {
    return this.byPath.get(path);
  }

  /** Items at the path and below it. */
  *below(path: string): Generator<Item> {
    const root = this.byPath.get(path);
    if (root !== undefined) yield* this.subtree(root);
    else for (const item of this.items.values()) if (path === "/" || item.path.startsWith(`${path}/`)) yield item;
  }

  *subtree(id: PrimId): Generator<Item> {
    const item = this.items.get(id);
    if (!item) return;
    yield item;
    for (const child of this.children.get(id) ?? []) yield* this.subtree(child);
  }

  /** The world matrix of an item: 12 numbers. It is valid until the next change. */
  world(id: PrimId): Float64Array {
    const place = this.places.get(id);
    return place === undefined ? IDENTITY : this.worlds.subarray(MATRIX_SIZE * place, MATRIX_SIZE * (place + 1));
  }

  localMatrix(id: PrimId): Float64Array {
    const place = this.places.get(id);
    return place === undefined ? IDENTITY : this.local.subarray(MATRIX_SIZE * place, MATRIX_SIZE * (place + 1));
  }

  /** The world matrix of what the local matrix of this item is relative to. */
  parentWorld(id: PrimId): Float64Array {
    const item = this.items.get(id);
    return !item || item.resetsStack ? IDENTITY : this.world(item.parent);
  }

  /** Whether the item and all its ancestors are visible. */
  isShown(id: PrimId): boolean {
    const place = this.places.get(id);
    return place !== undefined && this.shown[place] === 1;
  }

  private clear(): void {
    this.items.clear();
    this.materials.clear();
    this.instances.clear();
    this.byPath.clear();
    this.places.clear();
    this.children.clear();
    this.free.length = 0;
    this.used = 0;
    this.changes = { ...noChanges(), reset: true };
  }

  private put(item: Item): void {
    const old = this.items.get(item.id);
    if (old) {
      this.children.get(old.parent)?.delete(old.id);
      if (this.byPath.get(old.path) === old.id) this.byPath.delete(old.path);
    }
    this.items.set(item.id, item);
    this.byPath.set(item.path, item.id);
    const siblings = this.children.get(item.parent) ?? new Set<PrimId>();
    this.children.set(item.parent, siblings.add(item.id));
    let place = this.places.get(item.id);
    if (place === undefined) {
      place = this.free.pop() ?? this.used++;
      this.reserve(place + 1);
      this.places.set(item.id, place);
    }
    this.setLocal(place, item.matrix ?? IDENTITY, 0);
    this.changes.items.add(item.id);
  }

  private remove(id: PrimId): void {
    const item = this.items.get(id);
    if (!item) return;
    this.items.delete(id);
    this.instances.delete(id);
    this.children.get(item.parent)?.delete(id);
    if (this.byPath.get(item.path) === id) this.byPath.delete(item.path);
    const place = this.places.get(id);
    this.places.delete(id);
    if (place !== undefined) this.free.push(place);
    this.changes.items.add(id);
  }

  private reserve(places: number): void {
    if (places <= this.shown.length) return;
    const size = Math.max(places, 2 * this.shown.length);
    const grown = <T extends Float64Array | Uint8Array>(old: T, bigger: T): T => {
      bigger.set(old);
      return bigger;
    };
    this.local = grown(this.local, new Float64Array(MATRIX_SIZE * size));
    this.worlds = grown(this.worlds, new Float64Array(MATRIX_SIZE * size));
    this.shown = grown(this.shown, new Uint8Array(size));
  }

  /** A matrix that is not finite would hide its whole group: such an item keeps the identity. */
  private setLocal(place: number, matrix: ArrayLike<number>, at: number): void {
    const isGood = isFiniteAffine(matrix, at);
    for (let index = 0; index < MATRIX_SIZE; index++) {
      this.local[MATRIX_SIZE * place + index] = (isGood ? matrix[at + index] : IDENTITY[index]) as number;
    }
  }

  private hasMovedAncestor(id: PrimId, moved: Set<PrimId>): boolean {
    let parent = this.items.get(id)?.parent ?? 0;
    for (let depth = 0; parent !== 0 && depth < 1000; depth++) {
      if (moved.has(parent)) return true;
      parent = this.items.get(parent)?.parent ?? 0;
    }
    return false;
  }

  /** Computes world matrices and visibility of an item and everything below it. */
  private updateSubtree(id: PrimId, isNew = true): void {
    const item = this.items.get(id);
    const place = this.places.get(id);
    if (!item || place === undefined) return;
    const parent = this.places.get(item.parent);
    const isRoot = parent === undefined;
    if (isRoot || item.resetsStack) {
      this.worlds.set(this.local.subarray(MATRIX_SIZE * place, MATRIX_SIZE * (place + 1)), MATRIX_SIZE * place);
    } else {
      multiply(this.local, MATRIX_SIZE * place, this.worlds, MATRIX_SIZE * parent, this.worlds, MATRIX_SIZE * place);
    }
    this.changes.moved.add(id);
    if (isNew) this.updateShown(item, place, parent);
    for (const child of this.children.get(id) ?? []) this.updateSubtree(child, isNew);
  }

  private updateShown(item: Item, place: number, parent: number | undefined): void {
    const isShown = item.visible !== false && (parent === undefined || this.shown[parent] === 1) ? 1 : 0;
    if (this.shown[place] !== isShown) this.changes.items.add(item.id);
    this.shown[place] = isShown;
  }

  private setVisible(id: PrimId, visible: boolean): void {
    const item = this.items.get(id);
    if (!item || (item.visible !== false) === visible) return;
    item.visible = visible;
    this.updateSubtree(id);
  }

  private setColor(id: PrimId, rgba: Float32Array): void {
    const item = this.items.get(id);
    if (!item) return;
    item.color = [rgba[0] as number, rgba[1] as number, rgba[2] as number];
    const wasOpaque = (item.opacity ?? 1) >= 1;
    item.opacity = rgba[3] as number;
    this.changes.colors.add(id);
    if (wasOpaque !== item.opacity >= 1) this.changes.items.add(id);
  }
}
