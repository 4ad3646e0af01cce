// Keeps three.js objects for what the scene store holds, and changes only those that the store says have changed.
import {
  Box3,
  type BufferGeometry,
  Group,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  type Object3D,
  Points,
  PointsMaterial,
  type PointsMaterialParameters,
} from "three";
import { type BlobAnswer, Blobs } from "../core/blobs";
import { decodeGeometry } from "../core/geometry";
import type { Item, PrimId, Purpose, Subset, Vec3 } from "../core/protocol";
import type { SceneChanges, SceneStore } from "../core/scene";
import { extendBox, worldMatrix } from "./bounds";
import { DEFAULT_COLOR, Groups, type Part } from "./groups";
import { Instancers } from "./instancers";
import { linear, MaterialLibrary, type Variant } from "./materials";
import type { Outlined } from "./outline";
import { disposeShape, makeShape, rangeOf, type Shape } from "./shapes";

type Single = LineSegments<BufferGeometry, LineBasicMaterial> | Points<BufferGeometry, PointsMaterial>;

export class Content {
  readonly root = new Group();
  readonly materials: MaterialLibrary;
  readonly shapes: Blobs<Shape>;
  private readonly groups = new Groups(this.root);
  private readonly instancers: Instancers;
  private readonly singles = new Map<PrimId, Single>();
  /** Items by the hash of their geometry, to find those that waited for it. */
  private readonly users = new Map<string, Set<PrimId>>();
  private readonly hashes = new Map<PrimId, string>();
  private readonly stale = new Set<PrimId>();
  private purposes: ReadonlySet<Purpose> = new Set(["default", "proxy"]);

  constructor(
    private readonly store: SceneStore,
    fetchBlob: (hash: string) => Promise<BlobAnswer>,
    private readonly changed: () => void,
  ) {
    this.root.matrixAutoUpdate = false;
    this.instancers = new Instancers(this.root, store);
    this.materials = new MaterialLibrary((hash) => store.materials.get(hash), changed);
    this.shapes = new Blobs(
      fetchBlob,
      (buffer) => makeShape(decodeGeometry(buffer)),
      (hash) => this.arrived(hash),
    );
  }

  setPurposes(purposes: ReadonlySet<Purpose>): void {
    this.purposes = purposes;
    for (const id of this.store.items.keys()) this.stale.add(id);
    this.changed();
  }

  get isStale(): boolean {
    return this.stale.size > 0;
  }

  /** Returns whether anything came or went, so that boxes and lights have to be looked at again. */
  apply(changes: SceneChanges): boolean {
    if (changes.reset) this.clear();
    if (changes.reset || changes.items.size > 0) this.shapes.forgetFailures();
    const items = new Set([...changes.items, ...this.stale]);
    this.stale.clear();
    if (changes.materials.size > 0) {
      for (const hash of changes.materials) this.materials.forget(hash);
      for (const item of this.store.items.values()) if (uses(item, changes.materials)) items.add(item.id);
    }
    const instancers = new Set(changes.instances);
    for (const id of items) this.update(id, instancers);
    for (const id of changes.moved) if (!items.has(id)) this.move(id, instancers);
    for (const id of changes.colors) if (!items.has(id)) this.color(id, instancers);
    for (const id of instancers) {
      this.instancers.update(
        id,
        (item) => this.prototypeParts(item),
        (item) => colorOf(this.store.items.get(item)),
      );
    }
    this.groups.flush();
    return items.size > 0;
  }

  /** The box around items, without those that are not shown. */
  box(items: Iterable<Item>): Box3 {
    const box = new Box3();
    for (const item of items) {
      if (item.prototypeOf === undefined && this.store.isShown(item.id)) {
        extendBox(box, this.store, item, (one) => (one.geometry ? this.shapes.get(one.geometry)?.geometry : undefined));
      }
    }
    return box;
  }

  /** Returns the shapes at and below a path, at most `most`, to draw their outline. */
  outlined(path: string, color: string, most: number): Outlined[] {
    const found: Outlined[] = [];
    for (const item of this.store.below(path)) {
      if (found.length >= most) break;
      if (!this.store.isShown(item.id)) continue;
      const shape = item.geometry ? this.shapes.get(item.geometry) : undefined;
      if (shape && item.prototypeOf === undefined) {
        found.push({
          geometry: shape.whole,
          kind: shape.geometry.kind,
          matrix: worldMatrix(this.store, item.id),
          color,
        });
      }
      for (const mesh of this.instancers.meshesOf(item.id)) {
        const matrix = new Matrix4();
        for (let index = 0; index < Math.min(mesh.count, most - found.length); index++) {
          mesh.getMatrixAt(index, matrix);
          found.push({ geometry: mesh.geometry, kind: "mesh", matrix: matrix.clone(), color });
        }
      }
    }
    return found;
  }

  /** The item to which an object of the picture belongs. */
  ownerOf(object: Object3D, instance: number | undefined): PrimId | undefined {
    const { owner, owners } = object.userData as { owner?: PrimId; owners?: PrimId[] };
    return owner ?? owners?.[instance ?? 0];
  }

  /** Why an item is not drawn as it is, or undefined. */
  problemOf(item: Item): string | undefined {
    if (item.problem) return item.problem;
    const geometry = item.geometry ? this.shapes.problem(item.geometry) : undefined;
    if (geometry) return geometry;
    const material = item.material ? this.store.materials.get(item.material) : undefined;
    if (material?.problem) return material.problem;
    for (const use of Object.values(material?.textures ?? {})) {
      const problem = use ? this.materials.problems.get(use.hash) : undefined;
      if (problem) return problem;
    }
    return undefined;
  }

  /** Sets the size of points for a camera: three.js does not look at its angle. `lens` is its height at distance 1, inverse. */
  setLens(lens: number): void {
    for (const single of this.singles.values()) {
      if (!(single instanceof Points)) continue;
      const { width } = single.material.userData as { width: number };
      if (width > 0) single.material.size = width * lens;
    }
  }

  get draws(): number {
    return this.groups.draws + this.singles.size;
  }

  private clear(): void {
    const known = new Set([...this.hashes.keys(), ...this.singles.keys(), ...this.instancers.ids()]);
    for (const id of known) this.remove(id);
  }

  private remove(id: PrimId): void {
    this.groups.remove(id);
    this.instancers.remove(id);
    const single = this.singles.get(id);
    if (single) {
      this.root.remove(single);
      single.material.dispose();
      this.singles.delete(id);
    }
    this.setHash(id, undefined);
  }

  private setHash(id: PrimId, hash: string | undefined): void {
    const old = this.hashes.get(id);
    if (old === hash) return;
    if (old !== undefined) {
      const users = this.users.get(old);
      users?.delete(id);
      if (users?.size === 0) {
        this.users.delete(old);
        const shape = this.shapes.get(old);
        if (shape) disposeShape(shape);
        this.shapes.keepOnly(new Set(this.users.keys()));
      }
      this.hashes.delete(id);
    }
    if (hash === undefined) return;
    this.hashes.set(id, hash);
    const users = this.users.get(hash) ?? new Set<PrimId>();
    this.users.set(hash, users.add(id));
  }

  private arrived(hash: string): void {
    for (const id of this.users.get(hash) ?? []) this.stale.add(id);
    this.changed();
  }

  private update(id: PrimId, instancers: Set<PrimId>): void {
    const item = this.store.items.get(id);
    if (!item) {
      this.remove(id);
      return;
    }
    if (item.geometry) {
      // The old shape stays in the picture until the new one is here.
      this.shapes.want(item.geometry);
      const isWaiting =
        this.shapes.get(item.geometry) === undefined && this.shapes.problem(item.geometry) === undefined;
      const shown = this.hashes.get(id);
      if (isWaiting && shown !== undefined && shown !== item.geometry && this.store.isShown(id)) {
        const users = this.users.get(item.geometry) ?? new Set<PrimId>();
        this.users.set(item.geometry, users.add(id));
        return;
      }
    }
    if (item.prototypeOf !== undefined) instancers.add(item.prototypeOf);
    if (item.kind === "instancer") instancers.add(id);
    const single = this.singles.get(id);
    if (single) {
      this.root.remove(single);
      single.material.dispose();
      this.singles.delete(id);
    }
    this.setHash(id, item.geometry);
    const shape = item.geometry ? this.shapes.get(item.geometry) : undefined;
    const isShown =
      item.prototypeOf === undefined && this.store.isShown(id) && this.purposes.has(item.purpose ?? "default");
    if (!shape || !isShown) this.groups.remove(id);
    else if (shape.geometry.kind === "mesh")
      this.groups.put(id, this.parts(item, shape), this.store.world(id), colorOf(item));
    else {
      this.groups.remove(id);
      this.addSingle(item, shape);
    }
  }

  private move(id: PrimId, instancers: Set<PrimId>): void {
    const item = this.store.items.get(id);
    if (!item) return;
    if (item.prototypeOf !== undefined) instancers.add(item.prototypeOf);
    if (item.kind === "instancer") instancers.add(id);
    if (!this.groups.move(id, this.store.world(id))) this.update(id, instancers);
    const single = this.singles.get(id);
    if (single) {
      single.matrix.copy(worldMatrix(this.store, id));
      single.matrixWorldNeedsUpdate = true;
    }
  }

  private color(id: PrimId, instancers: Set<PrimId>): void {
    const item = this.store.items.get(id);
    if (!item) return;
    if (item.prototypeOf !== undefined) instancers.add(item.prototypeOf);
    if (!item.material) this.groups.color(id, colorOf(item));
    this.singles.get(id)?.material.color.copy(linear(colorOf(item)));
  }

  private prototypeParts(id: PrimId): Part[] {
    const item = this.store.items.get(id);
    const shape = item?.geometry ? this.shapes.get(item.geometry) : undefined;
    if (!item || !shape || shape.geometry.kind !== "mesh" || !this.purposes.has(item.purpose ?? "default")) return [];
    return this.parts(item, shape);
  }

  private parts(item: Item, shape: Shape): Part[] {
    const total = shape.geometry.indices?.length ?? 0;
    const opacity = item.material ? 1 : Math.round((item.opacity ?? 1) * 50) / 50;
    return withGaps(item.subsets ?? [], total, item.material ?? "").map(({ material, start, count }) => {
      const variant: Variant = {
        isFlat: shape.isFlat,
        hasColors: shape.hasColors && !material,
        isDoubleSided: item.doubleSided ?? false,
        opacity,
      };
      const look = `${material}|${this.materials.version(material)}|${variant.isFlat}|${variant.hasColors}|${variant.isDoubleSided}|${opacity}`;
      return {
        key: `${item.geometry}|${start}|${count}|${look}`,
        geometry: rangeOf(shape, start, count),
        material: () => this.materials.get(material, variant),
      };
    });
  }

  private addSingle(item: Item, shape: Shape): void {
    const opacity = item.opacity ?? 1;
    const options = {
      color: shape.hasColors ? 0xffffff : linear(colorOf(item)),
      vertexColors: shape.hasColors,
      transparent: opacity < 1,
      opacity,
    };
    const width = shape.geometry.widths?.[0] ?? 0;
    const single: Single =
      shape.geometry.kind === "curves"
        ? new LineSegments(shape.whole, new LineBasicMaterial(options))
        : new Points(shape.whole, pointsMaterial(width, options));
    single.matrixAutoUpdate = false;
    single.matrix.copy(worldMatrix(this.store, item.id));
    single.matrixWorldNeedsUpdate = true;
    single.userData.owner = item.id;
    this.singles.set(item.id, single);
    this.root.add(single);
  }
}

/** Round points of a width in units of the scene, or of 3 pixels without a width. */
function pointsMaterial(width: number, options: PointsMaterialParameters): PointsMaterial {
  const material = new PointsMaterial({ ...options, size: width > 0 ? width : 3, sizeAttenuation: width > 0 });
  material.userData.width = width;
  material.onBeforeCompile = (shader) => {
    shader.fragmentShader = shader.fragmentShader.replace(
      "#include <clipping_planes_fragment>",
      "#include <clipping_planes_fragment>\n  if (length(gl_PointCoord - 0.5) > 0.5) discard;",
    );
  };
  return material;
}

function uses(item: Item, materials: ReadonlySet<string>): boolean {
  return materials.has(item.material ?? "") || (item.subsets ?? []).some(({ material }) => materials.has(material));
}

/** The instances of a material have white: the material has the color. */
function colorOf(item: Item | undefined): Vec3 {
  if (item?.material) return [1, 1, 1];
  return item?.color ?? DEFAULT_COLOR;
}

/** Returns the subsets in order, with the item's own material for the triangles that are in none. */
export function withGaps(subsets: Subset[], total: number, material: string): Subset[] {
  const all: Subset[] = [];
  let at = 0;
  for (const subset of [...subsets].sort((one, other) => one.start - other.start)) {
    const start = Math.max(at, subset.start);
    const end = Math.min(total, subset.start + subset.count);
    if (end <= start) continue;
    if (start > at) all.push({ material, start: at, count: start - at });
    all.push({ material: subset.material, start, count: end - start });
    at = end;
  }
  if (at < total || all.length === 0) all.push({ material, start: at, count: total - at });
  return all;
}
