// Tests the scene store: world matrices, visibility, changes.
import { expect, test } from "vitest";
import { determinant, inverse, multiply } from "../src/core/affine";
import { decodeBatch } from "../src/core/batch";
import type { Item } from "../src/core/protocol";
import { SceneStore } from "../src/core/scene";
import { batchOf, bytesOf, shift } from "./bytes";

const item = (id: number, path: string, parent: number, more: Partial<Item> = {}): Item => ({
  id,
  path,
  parent,
  kind: "xform",
  matrix: shift(1, 0, 0),
  ...more,
});

const place = (store: SceneStore, id: number) => [...store.world(id).slice(9)];

function move(store: SceneStore, ...moves: [number, number[]][]): void {
  const ids = Uint32Array.from(moves, ([id]) => id);
  const content = bytesOf(ids, Float32Array.from(moves.flatMap(([, matrix]) => matrix)));
  store.applyBatch(decodeBatch(batchOf({ kind: 1, count: moves.length, content })));
}

function threeLevels(): SceneStore {
  const store = new SceneStore();
  store.applyScene({
    type: "scene",
    add: [item(3, "/A/B/C", 2), item(1, "/A", 0), item(2, "/A/B", 1), item(4, "/D", 0)],
  });
  return store;
}

test("world matrices follow the parents, which may come after their children", () => {
  const store = threeLevels();
  expect(place(store, 3)).toEqual([3, 0, 0]);
  expect(store.idOf("/A/B")).toBe(2);
  expect([...store.below("/A")].map(({ path }) => path)).toEqual(["/A", "/A/B", "/A/B/C"]);
});

test("a moved prim moves its subtree only", () => {
  const store = threeLevels();
  store.takeChanges();
  move(store, [2, shift(0, 5, 0)]);
  expect(place(store, 3)).toEqual([2, 5, 0]);
  expect(store.takeChanges().moved).toEqual(new Set([2, 3]));
  move(store, [1, shift(10, 0, 0)], [3, shift(0, 0, 1)], [99, shift(0, 0, 0)]);
  expect(place(store, 3)).toEqual([10, 5, 1]);
  expect(store.takeChanges().moved).toEqual(new Set([1, 2, 3]));
});

test("a prim that resets the stack ignores its parents", () => {
  const store = threeLevels();
  store.applyScene({ type: "scene", add: [item(5, "/A/R", 1, { resetsStack: true })] });
  expect(place(store, 5)).toEqual([1, 0, 0]);
  expect([...store.parentWorld(5)].slice(9)).toEqual([0, 0, 0]);
});

test("visibility is inherited", () => {
  const store = threeLevels();
  store.takeChanges();
  const content = bytesOf(Uint32Array.of(1), Uint8Array.of(0));
  store.applyBatch(decodeBatch(batchOf({ kind: 2, count: 1, content })));
  expect([1, 2, 3, 4].map((id) => store.isShown(id))).toEqual([false, false, false, true]);
  expect(store.takeChanges().items).toEqual(new Set([1, 2, 3]));
});

test("a matrix that is not finite leaves the prim at its parent", () => {
  const store = threeLevels();
  move(store, [2, shift(Number.NaN, 0, 0)]);
  expect(place(store, 3)).toEqual([2, 0, 0]);
});

test("items are replaced and removed, and a reset leaves none", () => {
  const store = threeLevels();
  store.applyScene({ type: "scene", add: [item(2, "/A/Renamed", 1)], remove: [4] });
  expect(store.idOf("/A/B")).toBeUndefined();
  expect(store.idOf("/A/Renamed")).toBe(2);
  expect(store.items.has(4)).toBe(false);
  store.applyScene({ type: "scene", reset: true, add: [item(1, "/New", 0)] });
  expect([...store.items.keys()]).toEqual([1]);
  expect(store.takeChanges().reset).toBe(true);
});

test("a thousand items keep their matrices while the arrays grow", () => {
  const store = new SceneStore();
  const add = Array.from({ length: 1000 }, (_, index) =>
    item(index + 1, `/P${index}`, 0, { matrix: shift(index, 0, 0) }),
  );
  store.applyScene({ type: "scene", add });
  expect(place(store, 777)).toEqual([776, 0, 0]);
});

test("a matrix times its inverse is the identity", () => {
  const matrix = Float64Array.of(0, 2, 0, -1, 0, 0, 0, 0, 3, 4, 5, 6);
  const out = new Float64Array(12);
  multiply(matrix, 0, inverse(matrix) as Float64Array, 0, out, 0);
  const identity = shift(0, 0, 0);
  for (let index = 0; index < 12; index++) expect(out[index]).toBeCloseTo(identity[index] as number, 12);
  expect(determinant(matrix)).toBe(6);
  expect(inverse(new Float64Array(12))).toBeUndefined();
});
