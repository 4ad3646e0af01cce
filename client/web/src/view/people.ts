// Shows where the others are: their cameras as frustums, and labels with their names.
import {
  BufferAttribute,
  BufferGeometry,
  type Camera,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  type Object3D,
  Vector3,
} from "three";
import type { Person } from "../core/protocol";
import { textOn } from "./colors";

/** A text that stays at a place of the scene. */
export interface Label {
  key: string;
  text: string;
  color: string;
  place: Vector3;
}

// The corners of a frustum of depth 1, seen from its camera, and the lines between them.
const CORNERS: [number, number, number][] = [
  [0, 0, 0],
  [-0.6, -0.36, -1],
  [0.6, -0.36, -1],
  [0.6, 0.36, -1],
  [-0.6, 0.36, -1],
  [0, 0.56, -1],
];
const LINES = [0, 1, 0, 2, 0, 3, 0, 4, 1, 2, 2, 3, 3, 4, 4, 1, 4, 5, 5, 3];

export class Frustums {
  private readonly geometry = new BufferGeometry();
  private readonly shown = new Map<string, LineSegments<BufferGeometry, LineBasicMaterial>>();

  constructor(private readonly parent: Object3D) {
    this.geometry.setAttribute(
      "position",
      new BufferAttribute(Float32Array.from(LINES.flatMap((corner) => CORNERS[corner] ?? [])), 3),
    );
  }

  /** Returns the labels of those who have a camera. `size` is the depth of a frustum in units of the scene. */
  update(people: Person[], size: number, except: string | undefined): Label[] {
    const labels: Label[] = [];
    const left = new Set(this.shown.keys());
    for (const person of people) {
      const matrix = cameraOf(person);
      if (!matrix || person.id === except) continue;
      left.delete(person.id);
      const lines = this.lines(person);
      matrix.decompose(lines.position, lines.quaternion, lines.scale);
      lines.scale.setScalar(size);
      lines.updateMatrixWorld();
      labels.push({
        key: `camera ${person.id}`,
        text: person.user,
        color: person.color,
        place: lines.position.clone(),
      });
    }
    for (const id of left) this.remove(id);
    return labels;
  }

  /** Hides frustums around the own camera, which would be lines through the picture. */
  hideNear(camera: Camera): void {
    const place = new Vector3().setFromMatrixPosition(camera.matrixWorld);
    for (const lines of this.shown.values()) lines.visible = lines.position.distanceTo(place) > 0.5 * lines.scale.x;
  }

  private lines(person: Person): LineSegments<BufferGeometry, LineBasicMaterial> {
    const known = this.shown.get(person.id);
    if (known) {
      known.material.color.set(person.color);
      return known;
    }
    const made = new LineSegments(this.geometry, new LineBasicMaterial({ color: person.color, toneMapped: false }));
    made.frustumCulled = false;
    this.shown.set(person.id, made);
    this.parent.add(made);
    return made;
  }

  private remove(id: string): void {
    const lines = this.shown.get(id);
    if (!lines) return;
    lines.material.dispose();
    this.parent.remove(lines);
    this.shown.delete(id);
  }
}

/** The world matrix of a person's view, or undefined if it is none. */
export function cameraOf(person: Person): Matrix4 | undefined {
  const { camera } = person;
  if (camera?.length !== 16 || !camera.every(Number.isFinite)) return undefined;
  return new Matrix4().fromArray(camera);
}

/** Keeps an HTML element for each label, over the picture. */
export class Labels {
  private readonly elements = new Map<string, HTMLElement>();

  constructor(private readonly parent: HTMLElement) {}

  update(labels: Label[], camera: Camera, width: number, height: number): void {
    const left = new Set(this.elements.keys());
    for (const { key, text, color, place } of labels) {
      const at = place.clone().project(camera);
      if (!(at.z > -1 && at.z < 1) || Math.abs(at.x) > 1.05 || Math.abs(at.y) > 1.05) continue;
      left.delete(key);
      const element = this.element(key);
      if (element.textContent !== text) element.textContent = text;
      element.style.backgroundColor = color;
      element.style.color = textOn(color);
      element.style.transform = `translate(-50%, -100%) translate(${Math.round(((at.x + 1) / 2) * width)}px, ${Math.round(((1 - at.y) / 2) * height - 6)}px)`;
    }
    for (const key of left) {
      this.elements.get(key)?.remove();
      this.elements.delete(key);
    }
  }

  private element(key: string): HTMLElement {
    const known = this.elements.get(key);
    if (known) return known;
    const made = document.createElement("div");
    made.className = "scene-label";
    this.parent.append(made);
    this.elements.set(key, made);
    return made;
  }
}
