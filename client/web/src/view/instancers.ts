// Draws the instances of PointInstancers: one instanced mesh for each part of a prototype.
import { DynamicDrawUsage, InstancedBufferAttribute, InstancedMesh, type Object3D } from "three";
import { inverse, multiply, writeColumns } from "../core/affine";
import { MATRIX_SIZE } from "../core/batch";
import type { PrimId, Vec3 } from "../core/protocol";
import type { SceneStore } from "../core/scene";
import type { Part } from "./groups";

/** A graphics card has other work, too: the rest of the instances is not drawn, and the page says so. */
export const MOST_INSTANCES = 2_000_000;

export class Instancers {
  private readonly meshes = new Map<PrimId, InstancedMesh[]>();

  constructor(
    private readonly parent: Object3D,
    private readonly store: SceneStore,
  ) {}

  remove(id: PrimId): void {
    for (const mesh of this.meshes.get(id) ?? []) {
      this.parent.remove(mesh);
      mesh.dispose();
    }
    this.meshes.delete(id);
  }

  /** Draws all instances of an instancer again. `partsOf` and `colorOf` say how an item of a prototype looks. */
  update(id: PrimId, partsOf: (item: PrimId) => Part[], colorOf: (item: PrimId) => Vec3): void {
    this.remove(id);
    const instances = this.store.instances.get(id);
    const roots = this.store.items.get(id)?.instances?.prototypes ?? [];
    if (!instances || !this.store.isShown(id)) return;
    const meshes: InstancedMesh[] = [];
    roots.forEach((root, prototype) => {
      const slots: number[] = [];
      for (let index = 0; index < Math.min(instances.count, MOST_INSTANCES); index++) {
        if (instances.prototypes[index] === prototype) slots.push(index);
      }
      if (slots.length === 0) return;
      const toRoot = inverse(this.store.parentWorld(root));
      if (!toRoot) return;
      for (const item of this.store.subtree(root)) {
        const parts = partsOf(item.id);
        if (parts.length === 0) continue;
        const matrices = this.matrices(id, item.id, toRoot, slots, instances.values);
        const colors = new Float32Array(3 * slots.length);
        for (let at = 0; at < colors.length; at += 3) colors.set(colorOf(item.id), at);
        for (const part of parts) {
          const mesh = new InstancedMesh(part.geometry, part.material(), slots.length);
          mesh.instanceMatrix.setUsage(DynamicDrawUsage);
          mesh.instanceMatrix.array.set(matrices);
          mesh.instanceColor = new InstancedBufferAttribute(colors, 3);
          mesh.frustumCulled = false;
          mesh.userData.owner = id;
          meshes.push(mesh);
          this.parent.add(mesh);
        }
      }
    });
    this.meshes.set(id, meshes);
  }

  ids(): IterableIterator<PrimId> {
    return this.meshes.keys();
  }

  meshesOf(id: PrimId): InstancedMesh[] {
    return this.meshes.get(id) ?? [];
  }

  private matrices(
    id: PrimId,
    item: PrimId,
    toRoot: Float64Array,
    slots: number[],
    values: Float32Array,
  ): Float32Array {
    const inPrototype = new Float64Array(MATRIX_SIZE);
    multiply(this.store.world(item), 0, toRoot, 0, inPrototype, 0);
    const inInstancer = new Float64Array(MATRIX_SIZE);
    const inWorld = new Float64Array(MATRIX_SIZE);
    const matrices = new Float32Array(16 * slots.length);
    slots.forEach((slot, index) => {
      multiply(inPrototype, 0, values, MATRIX_SIZE * slot, inInstancer, 0);
      multiply(inInstancer, 0, this.store.world(id), 0, inWorld, 0);
      writeColumns(inWorld, 0, matrices, 16 * index);
    });
    return matrices;
  }
}
