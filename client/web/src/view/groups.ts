// Draws meshes in groups: one instanced draw for all parts with the same geometry, material and side.
import {
  type BufferGeometry,
  DynamicDrawUsage,
  InstancedBufferAttribute,
  InstancedMesh,
  type Object3D,
  type Material as ThreeMaterial,
} from "three";
import { type Affine, determinant, writeColumns } from "../core/affine";
import type { PrimId, Vec3 } from "../core/protocol";

const FIRST_CAPACITY = 8;
/** The color that OpenUSD's own viewer gives to what has none. */
export const DEFAULT_COLOR: Vec3 = [0.5, 0.5, 0.5];

interface Place {
  group: Group;
  slot: number;
}

/**
 * A group of instances. Mirrored instances are in groups of their own: the group has a mirrored matrix, so that three.js
 * turns the front of their triangles.
 */
class Group {
  mesh: InstancedMesh;
  readonly owners: PrimId[] = [];
  private low = Number.POSITIVE_INFINITY;
  private high = -1;

  constructor(
    readonly key: string,
    private readonly parent: Object3D,
    geometry: BufferGeometry,
    material: ThreeMaterial,
    private readonly isMirrored: boolean,
  ) {
    this.mesh = this.create(geometry, material, FIRST_CAPACITY);
  }

  private create(geometry: BufferGeometry, material: ThreeMaterial, capacity: number): InstancedMesh {
    const mesh = new InstancedMesh(geometry, material, capacity);
    mesh.instanceMatrix.setUsage(DynamicDrawUsage);
    mesh.instanceColor = new InstancedBufferAttribute(new Float32Array(3 * capacity).fill(1), 3);
    mesh.frustumCulled = false;
    mesh.matrixAutoUpdate = false;
    if (this.isMirrored) mesh.matrix.makeScale(-1, 1, 1);
    mesh.matrixWorldNeedsUpdate = true;
    mesh.count = 0;
    mesh.userData.owners = this.owners;
    this.parent.add(mesh);
    return mesh;
  }

  add(owner: PrimId, world: Affine, color: Vec3): number {
    const slot = this.owners.length;
    if (slot === this.mesh.instanceMatrix.count) this.grow();
    this.owners.push(owner);
    this.mesh.count = this.owners.length;
    this.setMatrix(slot, world);
    this.setColor(slot, color);
    return slot;
  }

  setMatrix(slot: number, world: Affine): void {
    const { array } = this.mesh.instanceMatrix;
    writeColumns(world, 0, array as Float32Array, 16 * slot);
    if (this.isMirrored)
      for (let column = 0; column < 4; column++)
        array[16 * slot + 4 * column] = -(array[16 * slot + 4 * column] as number);
    this.touch(slot);
  }

  setColor(slot: number, color: Vec3): void {
    this.mesh.instanceColor?.setXYZ(slot, color[0], color[1], color[2]);
    if (this.mesh.instanceColor) this.mesh.instanceColor.needsUpdate = true;
  }

  /** Moves the last instance into the slot; returns its owner, or undefined if the slot was the last. */
  remove(slot: number): PrimId | undefined {
    const last = this.owners.length - 1;
    const owner = this.owners.pop() as PrimId;
    this.mesh.count = last;
    if (slot === last) return undefined;
    this.owners[slot] = owner;
    const { array } = this.mesh.instanceMatrix;
    array.copyWithin(16 * slot, 16 * last, 16 * last + 16);
    const colors = this.mesh.instanceColor;
    if (colors) {
      colors.array.copyWithin(3 * slot, 3 * last, 3 * last + 3);
      colors.needsUpdate = true;
    }
    this.touch(slot);
    return owner;
  }

  /** Gives the changed part of the matrices to the graphics card at the next frame. */
  flush(): void {
    if (this.high < 0) return;
    const { instanceMatrix } = this.mesh;
    instanceMatrix.clearUpdateRanges();
    instanceMatrix.addUpdateRange(16 * this.low, 16 * (this.high - this.low + 1));
    instanceMatrix.needsUpdate = true;
    // A pick computes it again.
    this.mesh.boundingSphere = null;
    this.low = Number.POSITIVE_INFINITY;
    this.high = -1;
  }

  dispose(): void {
    this.parent.remove(this.mesh);
    this.mesh.dispose();
  }

  private touch(slot: number): void {
    this.low = Math.min(this.low, slot);
    this.high = Math.max(this.high, slot);
  }

  private grow(): void {
    const old = this.mesh;
    const mesh = this.create(old.geometry, old.material as ThreeMaterial, 2 * old.instanceMatrix.count);
    mesh.instanceMatrix.array.set(old.instanceMatrix.array);
    if (old.instanceColor) mesh.instanceColor?.array.set(old.instanceColor.array);
    this.parent.remove(old);
    old.dispose();
    this.mesh = mesh;
    this.touch(0);
    this.touch(this.owners.length - 1);
  }
}

/** One thing to draw: a part of the geometry of an item, with one material. */
export interface Part {
  key: string;
  geometry: BufferGeometry;
  material: () => ThreeMaterial;
}

export class Groups {
  private readonly groups = new Map<string, Group>();
  private readonly places = new Map<PrimId, Place[]>();
  private readonly touched = new Set<Group>();

  constructor(private readonly parent: Object3D) {}

  /** Draws these parts for an item, in the place of those from before. */
  put(id: PrimId, parts: Part[], world: Affine, color: Vec3): void {
    this.remove(id);
    if (parts.length === 0) return;
    const isMirrored = determinant(world) < 0;
    this.places.set(
      id,
      parts.map((part) => {
        const group = this.groupOf(part, isMirrored);
        this.touched.add(group);
        return { group, slot: group.add(id, world, color) };
      }),
    );
  }

  remove(id: PrimId): void {
    for (const { group, slot } of this.places.get(id) ?? []) {
      const moved = group.remove(slot);
      if (moved !== undefined) this.renumber(moved, group, group.owners.length, slot);
      if (group.owners.length > 0) this.touched.add(group);
      else {
        group.dispose();
        this.groups.delete(group.key);
        this.touched.delete(group);
      }
    }
    this.places.delete(id);
  }

  /** Returns false if the item has to be put again, because it is mirrored now or no longer. */
  move(id: PrimId, world: Affine): boolean {
    const isMirrored = determinant(world) < 0;
    for (const { group, slot } of this.places.get(id) ?? []) {
      if (group.key.endsWith("mirrored") !== isMirrored) return false;
      group.setMatrix(slot, world);
      this.touched.add(group);
    }
    return true;
  }

  color(id: PrimId, color: Vec3): void {
    for (const { group, slot } of this.places.get(id) ?? []) group.setColor(slot, color);
  }

  has(id: PrimId): boolean {
    return this.places.has(id);
  }

  flush(): void {
    for (const group of this.touched) group.flush();
    this.touched.clear();
  }

  get draws(): number {
    return this.groups.size;
  }

  private renumber(owner: PrimId, group: Group, from: number, to: number): void {
    for (const place of this.places.get(owner) ?? []) if (place.group === group && place.slot === from) place.slot = to;
  }

  private groupOf(part: Part, isMirrored: boolean): Group {
    const key = `${part.key}|${isMirrored ? "mirrored" : "plain"}`;
    let group = this.groups.get(key);
    if (!group) {
      group = new Group(key, this.parent, part.geometry, part.material(), isMirrored);
      this.groups.set(key, group);
    }
    return group;
  }
}
