// Decodes the geometry of meshes, curves and points as the gateway serves it, and makes the normals that it left out.
import { BadBytes, needBytes, openBuffer, readSections } from "./sections";

const GEOMETRY_MAGIC = 0x55534c47;
const KINDS = ["", "mesh", "curves", "points"] as const;

export interface Geometry {
  kind: "mesh" | "curves" | "points";
  positions: Float32Array;
  normals?: Float32Array;
  uvs?: Float32Array;
  colors?: Float32Array;
  indices?: Uint32Array;
  faces?: Uint32Array;
  widths?: Float32Array;
  smooth: boolean;
  /** The box around the finite positions; all of it is 0 if there are none. */
  low: [number, number, number];
  high: [number, number, number];
}

/** Throws BadBytes if the bytes are damaged, or if an index names a point that is not there. */
export function decodeGeometry(buffer: ArrayBuffer): Geometry {
  const what = "geometry";
  const view = openBuffer(buffer, GEOMETRY_MAGIC, 12, what);
  const kind = KINDS[view.getUint32(4, true)];
  if (!kind) throw new BadBytes(`${what}: the kind ${view.getUint32(4, true)} is unknown`);
  const geometry: Geometry = { kind, positions: new Float32Array(0), smooth: false, low: [0, 0, 0], high: [0, 0, 0] };
  for (const section of readSections(view, 12, view.getUint32(8, true), what)) {
    const { count, offset } = section;
    const floats = (width: number) => {
      needBytes(section, 4 * width * count, what);
      return new Float32Array(buffer, offset, width * count);
    };
    const integers = () => {
      needBytes(section, 4 * count, what);
      return new Uint32Array(buffer, offset, count);
    };
    if (section.kind === 1) geometry.positions = floats(3);
    else if (section.kind === 2) geometry.normals = floats(3);
    else if (section.kind === 3) geometry.uvs = floats(2);
    else if (section.kind === 4) geometry.colors = floats(3);
    else if (section.kind === 5) geometry.indices = integers();
    else if (section.kind === 6) geometry.faces = integers();
    else if (section.kind === 7) geometry.widths = floats(1);
    else if (section.kind === 8) geometry.smooth = (integers()[0] ?? 0) % 2 === 1;
  }
  check(geometry);
  measure(geometry);
  return geometry;
}

function check(geometry: Geometry): void {
  const points = geometry.positions.length / 3;
  for (const [name, width] of [
    ["normals", 3],
    ["uvs", 2],
    ["colors", 3],
    ["widths", 1],
  ] as const) {
    const values = geometry[name];
    if (values && values.length !== width * points) {
      throw new BadBytes(`geometry: ${values.length / width} ${name} for ${points} points`);
    }
  }
  for (const index of geometry.indices ?? []) {
    if (index >= points) throw new BadBytes(`geometry: an index names point ${index} of ${points}`);
  }
}

function measure(geometry: Geometry): void {
  const { positions, low, high } = geometry;
  let isFirst = true;
  for (let at = 0; at + 2 < positions.length; at += 3) {
    const point = [positions[at] as number, positions[at + 1] as number, positions[at + 2] as number];
    if (!point.every(Number.isFinite)) continue;
    for (let axis = 0; axis < 3; axis++) {
      const value = point[axis] as number;
      low[axis] = isFirst ? value : Math.min(low[axis] as number, value);
      high[axis] = isFirst ? value : Math.max(high[axis] as number, value);
    }
    isFirst = false;
  }
}

/** Returns a normal for each point of an indexed mesh: the sum of the normals of its triangles, weighted by area. */
export function smoothNormals(positions: Float32Array, indices: Uint32Array): Float32Array {
  const normals = new Float32Array(positions.length);
  for (let at = 0; at + 2 < indices.length; at += 3) {
    const corners = [indices[at] as number, indices[at + 1] as number, indices[at + 2] as number];
    const normal = triangleNormal(positions, corners);
    for (const corner of corners) {
      for (let axis = 0; axis < 3; axis++) {
        normals[3 * corner + axis] = (normals[3 * corner + axis] as number) + (normal[axis] as number);
      }
    }
  }
  for (let at = 0; at + 2 < normals.length; at += 3) normalize(normals, at);
  return normals;
}

function triangleNormal(positions: Float32Array, corners: number[]): [number, number, number] {
  const [a, b, c] = corners.map((corner) => 3 * corner) as [number, number, number];
  const p = (at: number) => positions[at] as number;
  const [ux, uy, uz] = [p(b) - p(a), p(b + 1) - p(a + 1), p(b + 2) - p(a + 2)];
  const [vx, vy, vz] = [p(c) - p(a), p(c + 1) - p(a + 1), p(c + 2) - p(a + 2)];
  const normal: [number, number, number] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
  return normal.every(Number.isFinite) ? normal : [0, 0, 0];
}

function normalize(values: Float32Array, at: number): void {
  const length = Math.hypot(values[at] as number, values[at + 1] as number, values[at + 2] as number) || 1;
  for (let axis = 0; axis < 3; axis++) values[at + axis] = (values[at + axis] as number) / length;
}
