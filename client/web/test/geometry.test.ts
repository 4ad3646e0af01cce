// Tests the decoding of geometry blobs, also of damaged ones.
import { expect, test } from "vitest";
import { decodeGeometry, smoothNormals } from "../src/core/geometry";
import { BadBytes } from "../src/core/sections";
import { bytesOf, geometryOf } from "./bytes";

const positions = { kind: 1, count: 3, content: bytesOf(Float32Array.of(0, 0, 0, 2, 0, 0, 0, 2, -1)) };
const triangle = { kind: 5, count: 3, content: bytesOf(Uint32Array.of(0, 1, 2)) };

test("a mesh is decoded and measured", () => {
  const uvs = { kind: 3, count: 3, content: bytesOf(Float32Array.of(0, 0, 1, 0, 0, 1)) };
  const smooth = { kind: 8, count: 1, content: bytesOf(Uint32Array.of(1)) };
  const geometry = decodeGeometry(geometryOf(1, positions, triangle, uvs, smooth));
  expect(geometry).toMatchObject({ kind: "mesh", smooth: true, low: [0, 0, -1], high: [2, 2, 0] });
  expect([...(geometry.indices ?? [])]).toEqual([0, 1, 2]);
  expect(geometry.normals).toBeUndefined();
});

test("points that are not finite are left out of the box", () => {
  const content = bytesOf(Float32Array.of(Number.NaN, 0, 0, 1, 1, 1, 0, Number.POSITIVE_INFINITY, 0));
  expect(decodeGeometry(geometryOf(3, { ...positions, content }))).toMatchObject({ low: [1, 1, 1], high: [1, 1, 1] });
});

test("bad geometry is refused with a reason", () => {
  const outside = { ...triangle, content: bytesOf(Uint32Array.of(0, 1, 3)) };
  expect(() => decodeGeometry(geometryOf(1, positions, outside))).toThrow("an index names point 3 of 3");
  const few = { kind: 2, count: 2, content: bytesOf(new Float32Array(6)) };
  expect(() => decodeGeometry(geometryOf(1, positions, few))).toThrow("2 normals for 3 points");
  expect(() => decodeGeometry(geometryOf(9, positions))).toThrow("kind 9 is unknown");
  const whole = geometryOf(1, positions, triangle);
  for (let size = 0; size < whole.byteLength; size++) {
    expect(() => decodeGeometry(whole.slice(0, size)), `${size} bytes`).toThrow(BadBytes);
  }
});

test("normals of a mesh follow its triangles, also degenerate ones", () => {
  const flat = smoothNormals(Float32Array.of(0, 0, 0, 1, 0, 0, 0, 1, 0), Uint32Array.of(0, 1, 2, 0, 0, 1));
  expect([...flat]).toEqual([0, 0, 1, 0, 0, 1, 0, 0, 1]);
});
