// Builds batches and geometry blobs for tests.

export function sections(header: number[], list: { kind: number; count: number; content: Uint8Array }[]): ArrayBuffer {
  const padded = list.map(({ content }) => {
    const bytes = new Uint8Array(Math.ceil(content.length / 4) * 4);
    bytes.set(content);
    return bytes;
  });
  const size = 4 * (header.length + 1) + padded.reduce((sum, bytes) => sum + 12 + bytes.length, 0);
  const buffer = new ArrayBuffer(size);
  const view = new DataView(buffer);
  let at = 0;
  for (const number of [...header, list.length]) {
    view.setUint32(at, number, true);
    at += 4;
  }
  list.forEach(({ kind, count }, index) => {
    const bytes = padded[index] as Uint8Array;
    for (const number of [kind, count, bytes.length]) {
      view.setUint32(at, number, true);
      at += 4;
    }
    new Uint8Array(buffer, at).set(bytes);
    at += bytes.length;
  });
  return buffer;
}

export function bytesOf(...arrays: (Uint32Array | Float32Array | Uint8Array)[]): Uint8Array {
  const parts = arrays.map((array) => new Uint8Array(array.buffer, array.byteOffset, array.byteLength));
  const all = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.length;
  }
  return all;
}

export const batchOf = (...list: { kind: number; count: number; content: Uint8Array }[]) =>
  sections([0x55534c50], list);
export const geometryOf = (kind: number, ...list: { kind: number; count: number; content: Uint8Array }[]) =>
  sections([0x55534c47, kind], list);

/** A matrix that moves by (x, y, z). */
export const shift = (x: number, y: number, z: number) => [1, 0, 0, 0, 1, 0, 0, 0, 1, x, y, z];
