// Tests the decoding of batches, also of damaged ones.
import { expect, test } from "vitest";
import { decodeBatch } from "../src/core/batch";
import { BadBytes } from "../src/core/sections";
import { batchOf, bytesOf, shift } from "./bytes";

const matrices = {
  kind: 1,
  count: 2,
  content: bytesOf(Uint32Array.of(7, 9), Float32Array.from([...shift(1, 2, 3), ...shift(4, 5, 6)])),
};

test("a batch with every kind of section is decoded", () => {
  const hash = Uint8Array.from({ length: 32 }, (_, index) => index);
  const batch = decodeBatch(
    batchOf(
      matrices,
      { kind: 2, count: 3, content: bytesOf(Uint32Array.of(1, 2, 3), Uint8Array.of(1, 0, 1)) },
      { kind: 3, count: 1, content: bytesOf(Uint32Array.of(4), Float32Array.of(0.25, 0.5, 0.75, 1)) },
      { kind: 4, count: 1, content: bytesOf(Uint32Array.of(5), hash) },
      { kind: 77, count: 1, content: bytesOf(Uint32Array.of(1)) },
      { kind: 6, count: 1, content: bytesOf(Uint32Array.of(8), Float32Array.from(shift(0, 0, 1)), Uint32Array.of(2)) },
    ),
  );
  expect([...(batch.matrices[0]?.ids ?? [])]).toEqual([7, 9]);
  expect([...(batch.matrices[0]?.values.slice(21) ?? [])]).toEqual([4, 5, 6]);
  expect([...(batch.visibility[0]?.visible ?? [])]).toEqual([1, 0, 1]);
  expect([...(batch.colors[0]?.values ?? [])]).toEqual([0.25, 0.5, 0.75, 1]);
  expect(batch.geometry[0]?.hashes[0]).toMatch(/^000102.*1e1f$/);
  expect(batch.instances[0]).toMatchObject({ id: 8, count: 1 });
  expect([...(batch.instances[0]?.prototypes ?? [])]).toEqual([2]);
});

test("every truncated batch is refused with a reason", () => {
  const whole = batchOf(matrices);
  for (let size = 0; size < whole.byteLength; size++) {
    expect(() => decodeBatch(whole.slice(0, size)), `${size} bytes`).toThrow(BadBytes);
  }
});

test("counts and lengths that do not fit are refused", () => {
  const lying = { ...matrices, count: 3 };
  expect(() => decodeBatch(batchOf(lying))).toThrow(/104 bytes, but 3 items need 156/);
  const huge = batchOf(matrices);
  new DataView(huge).setUint32(16, 0xfffffffc, true);
  expect(() => decodeBatch(huge)).toThrow(/4294967292 bytes/);
  const other = batchOf(matrices);
  new DataView(other).setUint32(0, 1, true);
  expect(() => decodeBatch(other)).toThrow(/begins with 1/);
});
