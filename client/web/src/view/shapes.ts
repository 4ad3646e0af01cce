// Makes three.js geometries of decoded ones, and shares them between the groups that draw them.
import { BufferAttribute, BufferGeometry } from "three";
import { type Geometry, smoothNormals } from "../core/geometry";

export interface Shape {
  geometry: Geometry;
  whole: BufferGeometry;
  /** Without normals a shader makes flat ones. */
  isFlat: boolean;
  hasColors: boolean;
  ranges: Map<string, BufferGeometry>;
}

export function makeShape(geometry: Geometry): Shape {
  const whole = new BufferGeometry();
  whole.setAttribute("position", new BufferAttribute(geometry.positions, 3));
  let { normals } = geometry;
  if (!normals && geometry.smooth && geometry.indices) normals = smoothNormals(geometry.positions, geometry.indices);
  if (normals) whole.setAttribute("normal", new BufferAttribute(normals, 3));
  if (geometry.uvs) whole.setAttribute("uv", new BufferAttribute(geometry.uvs, 2));
  if (geometry.colors) whole.setAttribute("color", new BufferAttribute(geometry.colors, 3));
  if (geometry.indices) whole.setIndex(new BufferAttribute(geometry.indices, 1));
  whole.computeBoundingSphere();
  return { geometry, whole, isFlat: !normals, hasColors: geometry.colors !== undefined, ranges: new Map() };
}

/** Returns the geometry that draws `count` indices from `start`; it shares the buffers of the whole. */
export function rangeOf(shape: Shape, start: number, count: number): BufferGeometry {
  const total = shape.geometry.indices?.length ?? 0;
  if (start === 0 && count >= total) return shape.whole;
  const key = `${start}:${count}`;
  const known = shape.ranges.get(key);
  if (known) return known;
  const part = new BufferGeometry();
  for (const [name, attribute] of Object.entries(shape.whole.attributes)) part.setAttribute(name, attribute);
  part.setIndex(shape.whole.index);
  part.setDrawRange(start, Math.min(count, total - start));
  part.boundingSphere = shape.whole.boundingSphere;
  shape.ranges.set(key, part);
  return part;
}

export function disposeShape(shape: Shape): void {
  shape.whole.dispose();
  for (const part of shape.ranges.values()) part.dispose();
}
