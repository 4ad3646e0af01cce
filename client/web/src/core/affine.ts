// Multiplies and inverts affine matrices in flat arrays: 12 numbers each, rows 0 to 3 and columns 0 to 2, row vectors.

export type Affine = Float32Array | Float64Array;

export const IDENTITY = Float64Array.of(1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0);

/** out = a * b: first a, then b. `out` must be another array than `a` and `b`, or another place in it. */
export function multiply(a: Affine, aAt: number, b: Affine, bAt: number, out: Affine, outAt: number): void {
  for (let row = 0; row < 4; row++) {
    const x = a[aAt + 3 * row] as number;
    const y = a[aAt + 3 * row + 1] as number;
    const z = a[aAt + 3 * row + 2] as number;
    for (let column = 0; column < 3; column++) {
      let sum =
        x * (b[bAt + column] as number) + y * (b[bAt + 3 + column] as number) + z * (b[bAt + 6 + column] as number);
      if (row === 3) sum += b[bAt + 9 + column] as number;
      out[outAt + 3 * row + column] = sum;
    }
  }
}

export function determinant(m: Affine, at = 0): number {
  const [a, b, c, d, e, f, g, h, i] = m.subarray(at, at + 9) as unknown as number[];
  return (
    (a as number) * ((e as number) * (i as number) - (f as number) * (h as number)) -
    (b as number) * ((d as number) * (i as number) - (f as number) * (g as number)) +
    (c as number) * ((d as number) * (h as number) - (e as number) * (g as number))
  );
}

/** Returns the inverse, or undefined if there is none. */
export function inverse(m: Affine, at = 0): Float64Array | undefined {
  const det = determinant(m, at);
  if (!Number.isFinite(1 / det)) return undefined;
  const e = (row: number, column: number) => m[at + 3 * row + column] as number;
  const out = new Float64Array(12);
  for (let row = 0; row < 3; row++) {
    for (let column = 0; column < 3; column++) {
      const [r0, r1] = [(column + 1) % 3, (column + 2) % 3];
      const [c0, c1] = [(row + 1) % 3, (row + 2) % 3];
      out[3 * row + column] = (e(r0, c0) * e(r1, c1) - e(r0, c1) * e(r1, c0)) / det;
    }
  }
  for (let column = 0; column < 3; column++) {
    let sum = 0;
    for (let row = 0; row < 3; row++) sum += e(3, row) * (out[3 * row + column] as number);
    out[9 + column] = -sum;
  }
  return out;
}

/** Returns whether all 12 numbers are finite. */
export function isFiniteAffine(m: ArrayLike<number>, at = 0): boolean {
  for (let index = 0; index < 12; index++) if (!Number.isFinite(m[at + index])) return false;
  return true;
}

/** Writes the matrix as the 16 numbers that WebGL reads by columns, which for column vectors is the same matrix. */
export function writeColumns(m: Affine, at: number, out: Float32Array | number[], outAt: number): void {
  for (let row = 0; row < 4; row++) {
    for (let column = 0; column < 3; column++) out[outAt + 4 * row + column] = m[at + 3 * row + column] as number;
    out[outAt + 4 * row + 3] = row === 3 ? 1 : 0;
  }
}
