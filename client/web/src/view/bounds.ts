// Computes boxes around items in the world.
import { Box3, Matrix4, Vector3 } from "three";
import { multiply, writeColumns } from "../core/affine";
import { MATRIX_SIZE } from "../core/batch";
import type { Geometry } from "../core/geometry";
import type { Item, PrimId } from "../core/protocol";
import type { SceneStore } from "../core/scene";

/** More instances of one instancer than these do not make its box much better. */
const MEASURED_INSTANCES = 5_000;

export function worldMatrix(store: SceneStore, id: PrimId): Matrix4 {
  const columns = new Array<number>(16).fill(0);
  writeColumns(store.world(id), 0, columns, 0);
  return new Matrix4().fromArray(columns);
}

/** Extends the box by what the item draws; `geometryOf` returns its decoded geometry if that is here. */
export function extendBox(
  box: Box3,
  store: SceneStore,
  item: Item,
  geometryOf: (item: Item) => Geometry | undefined,
): void {
  const geometry = geometryOf(item);
  if (geometry && geometry.positions.length > 0) {
    box.union(boxOf(geometry).applyMatrix4(worldMatrix(store, item.id)));
  }
  const instances = store.instances.get(item.id);
  if (!instances) return;
  const boxes = (item.instances?.prototypes ?? []).map((root) => prototypeBox(store, root, geometryOf));
  const world = new Float64Array(MATRIX_SIZE);
  const columns = new Array<number>(16).fill(0);
  for (let index = 0; index < Math.min(instances.count, MEASURED_INSTANCES); index++) {
    const prototype = boxes[instances.prototypes[index] ?? 0];
    if (!prototype || prototype.isEmpty()) continue;
    multiply(instances.values, MATRIX_SIZE * index, store.world(item.id), 0, world, 0);
    writeColumns(world, 0, columns, 0);
    box.union(prototype.clone().applyMatrix4(new Matrix4().fromArray(columns)));
  }
}

function boxOf({ low, high }: Geometry): Box3 {
  return new Box3(new Vector3(...low), new Vector3(...high));
}

function prototypeBox(store: SceneStore, root: PrimId, geometryOf: (item: Item) => Geometry | undefined): Box3 {
  const columns = new Array<number>(16).fill(0);
  writeColumns(store.parentWorld(root), 0, columns, 0);
  const toRoot = new Matrix4().fromArray(columns).invert();
  const box = new Box3();
  for (const item of store.subtree(root)) {
    const geometry = geometryOf(item);
    if (geometry) box.union(boxOf(geometry).applyMatrix4(toRoot.clone().multiply(worldMatrix(store, item.id))));
  }
  return box;
}
