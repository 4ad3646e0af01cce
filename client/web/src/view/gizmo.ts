// Lets a person move, turn and scale a prim with handles in the picture.
import { type Camera, Matrix4, Object3D, type Quaternion, type Object3D as Three, Vector3 } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";
import { inverse, multiply, writeColumns } from "../core/affine";
import type { PrimId } from "../core/protocol";
import type { SceneStore } from "../core/scene";

export type GizmoMode = "translate" | "rotate" | "scale";

export interface GizmoHandler {
  /** The prim's new local matrix. `commit` is true once, at the end of a drag. */
  transformed(path: string, matrix: number[], commit: boolean): void;
  draggingChanged(isDragging: boolean): void;
  changed(): void;
}

/**
 * The handles are at an object of their own. What a drag does to it is done to the prim's world matrix, so that shear and
 * mirroring of the prim survive.
 */
export class Gizmo {
  private readonly controls: TransformControls;
  private readonly handle = new Object3D();
  private id: PrimId | undefined;
  private start: { handle: Matrix4; world: Matrix4; toLocal: Float64Array } | undefined;

  constructor(
    camera: Camera,
    element: HTMLElement,
    scene: Three,
    private readonly store: SceneStore,
    private readonly handler: GizmoHandler,
  ) {
    this.controls = new TransformControls(camera, element);
    this.controls.setSpace("local");
    this.controls.size = 0.85;
    scene.add(this.handle, this.controls.getHelper());
    this.controls.addEventListener("change", () => handler.changed());
    this.controls.addEventListener("objectChange", () => this.drag(false));
    this.controls.addEventListener("dragging-changed", ({ value }) => {
      if (value === true) this.begin();
      else this.drag(true);
      handler.draggingChanged(value === true);
    });
    this.controls.enabled = false;
    this.controls.getHelper().visible = false;
  }

  get isDragging(): boolean {
    return this.start !== undefined;
  }

  /** Whether the pointer is over a handle, so that a click is none into the picture. */
  get isHovered(): boolean {
    return this.controls.enabled && this.controls.axis !== null;
  }

  set camera(camera: Camera) {
    this.controls.camera = camera;
  }

  set mode(mode: GizmoMode) {
    this.controls.setMode(mode);
  }

  /** Shows the handles at an item, or hides them. */
  attach(id: PrimId | undefined): void {
    if (this.isDragging && id === this.id) return;
    this.id = id;
    this.start = undefined;
    this.controls.enabled = id !== undefined;
    if (id === undefined) this.controls.detach();
    else {
      this.follow();
      this.controls.attach(this.handle);
    }
    this.handler.changed();
  }

  /** Puts the handles where the prim is now. */
  follow(): void {
    if (this.id === undefined || this.isDragging) return;
    const world = this.world();
    world.decompose(this.handle.position, this.handle.quaternion as Quaternion, new Vector3());
    this.handle.scale.setScalar(1);
    this.handle.updateMatrixWorld();
  }

  /** The prim that is dragged: what arrives for it meanwhile is older than the drag. */
  get dragged(): PrimId | undefined {
    return this.isDragging ? this.id : undefined;
  }

  private world(): Matrix4 {
    const columns = new Array<number>(16).fill(0);
    writeColumns(this.store.world(this.id ?? 0), 0, columns, 0);
    return new Matrix4().fromArray(columns);
  }

  private begin(): void {
    if (this.id === undefined) return;
    const toLocal = inverse(this.store.parentWorld(this.id));
    this.handle.updateMatrixWorld();
    if (toLocal) this.start = { handle: this.handle.matrixWorld.clone().invert(), world: this.world(), toLocal };
  }

  private drag(commit: boolean): void {
    const { start, id } = this;
    const item = id === undefined ? undefined : this.store.items.get(id);
    if (commit) this.start = undefined;
    if (!start || !item) return;
    this.handle.updateMatrixWorld();
    const { elements } = this.handle.matrixWorld.clone().multiply(start.handle).multiply(start.world);
    const world = new Float64Array(12);
    for (let row = 0; row < 4; row++)
      for (let column = 0; column < 3; column++) world[3 * row + column] = elements[4 * row + column] as number;
    const local = new Float64Array(12);
    multiply(world, 0, start.toLocal, 0, local, 0);
    this.store.move(item.id, local);
    this.handler.transformed(item.path, [...local], commit);
    if (commit) this.follow();
  }
}
