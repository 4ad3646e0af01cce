// Shows the stage: draws when something changed, and lets a person look around, pick and move.
import {
  type Box3,
  type Camera,
  GridHelper,
  Matrix4,
  NeutralToneMapping,
  OrthographicCamera,
  PerspectiveCamera,
  Quaternion,
  Raycaster,
  Scene,
  Sphere,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { CameraShape, Person, PrimId, Purpose } from "../core/protocol";
import type { SceneStore } from "../core/scene";
import { worldMatrix } from "./bounds";
import { Content } from "./content";
import { makeEnvironment } from "./environment";
import { Gizmo, type GizmoMode } from "./gizmo";
import { Lights } from "./lights";
import { type Outlined, Outlines } from "./outline";
import { cameraOf, Frustums, type Label, Labels } from "./people";

export interface ViewportHandler {
  picked(path: string | undefined, isAdded: boolean): void;
  /** The world matrix of this person's view: 16 numbers, as USD writes them. */
  cameraMoved(matrix: number[]): void;
  transformed(path: string, matrix: number[], commit: boolean): void;
  /** The person moves the camera, so it no longer follows somebody or looks through a camera of the stage. */
  navigated(): void;
}

const OWN_COLOR = "#ffb020";
/** More shapes of one selection are not outlined: the outline costs a draw for each. */
const MOST_OUTLINED = 600;
const CLICK_PIXELS = 4;
const FIELD_OF_VIEW = 45;
const FIT_MARGIN = 1.12;

export interface FrameStats {
  frames: number;
  /** Milliseconds of the main thread in the newest frames, the newest last; at most 600. */
  milliseconds: number[];
  draws: number;
}

export class Viewport {
  readonly stats: FrameStats = { frames: 0, milliseconds: [], draws: 0 };
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 1000);
  private readonly orbit: OrbitControls;
  private readonly gizmo: Gizmo;
  private readonly content: Content;
  private readonly lights: Lights;
  private readonly outlines = new Outlines();
  private readonly frustums = new Frustums(this.scene);
  private readonly labels: Labels;
  private grid: GridHelper | undefined;
  private people: Person[] = [];
  private selection: string[] = [];
  private marks: Label[] = [];
  private followed: string | undefined;
  private stageCamera: PrimId | undefined;
  private gizmoMode: GizmoMode | undefined;
  private bounds = new Sphere(new Vector3(), 1);
  private isAutoFraming = true;
  private isComplete = false;
  private boundsAreOld = true;
  private boundsTime = 0;
  private lightsAreOld = true;
  private marksAreOld = true;
  private isRequested = false;
  private isDark = true;
  private hasEnvironment = false;
  private readonly sent = new Matrix4();
  private readonly observer: ResizeObserver;

  /** Throws if the browser has no WebGL 2. */
  constructor(
    private readonly host: HTMLElement,
    private readonly store: SceneStore,
    private readonly handler: ViewportHandler,
  ) {
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.autoClear = false;
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    const canvas = this.renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("role", "img");
    canvas.setAttribute(
      "aria-label",
      "Picture of the stage. Arrow keys turn the view, plus and minus zoom, F frames the selection.",
    );
    host.append(canvas);
    const labels = document.createElement("div");
    labels.className = "scene-labels";
    host.append(labels);
    this.labels = new Labels(labels);
    this.content = new Content(
      store,
      (hash) => fetch(`/blob/${hash}`),
      () => this.requestFrame(),
    );
    this.scene.add(this.content.root, this.camera);
    this.lights = new Lights(this.scene, this.camera);
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.zoomToCursor = true;
    this.orbit.addEventListener("change", () => this.requestFrame());
    this.orbit.addEventListener("start", () => this.navigated());
    this.gizmo = new Gizmo(this.camera, canvas, this.scene, store, {
      transformed: (path, matrix, commit) => handler.transformed(path, matrix, commit),
      draggingChanged: (isDragging) => {
        this.orbit.enabled = !isDragging && this.stageCamera === undefined;
      },
      changed: () => this.requestFrame(),
    });
    this.listen(canvas);
    this.observer = new ResizeObserver(() => this.requestFrame());
    this.observer.observe(host);
    this.setUpAxis("Y");
  }

  dispose(): void {
    this.observer.disconnect();
    this.renderer.dispose();
    this.host.replaceChildren();
  }

  requestFrame(): void {
    if (this.isRequested) return;
    this.isRequested = true;
    requestAnimationFrame(() => this.frame());
  }

  setUpAxis(up: "Y" | "Z"): void {
    const isY = up === "Y";
    this.camera.up.set(0, isY ? 1 : 0, isY ? 0 : 1);
    // OrbitControls reads the up axis only when it is made; this is what it computes of it.
    const orbit = this.orbit as unknown as { _quat: Quaternion; _quatInverse: Quaternion };
    orbit._quat.setFromUnitVectors(this.camera.up, new Vector3(0, 1, 0));
    orbit._quatInverse.copy(orbit._quat).invert();
    this.lights.setUp(up);
    this.scene.environmentRotation.set(isY ? 0 : Math.PI / 2, 0, 0);
    if (this.isAutoFraming) this.camera.position.set(1, isY ? 0.7 : -1.4, isY ? 1.4 : 0.7);
    this.boundsAreOld = true;
    this.requestFrame();
  }

  /** Called after each message about the scene. The first complete one is framed. */
  sceneArrived(isReset: boolean, isComplete: boolean, isOtherStage: boolean): void {
    if (isReset && isOtherStage) this.isAutoFraming = true;
    this.isComplete = isComplete;
    this.requestFrame();
  }

  setTheme(isDark: boolean): void {
    this.isDark = isDark;
    this.boundsAreOld = true;
    if (this.grid) {
      this.scene.remove(this.grid);
      this.grid.dispose();
      this.grid = undefined;
    }
    this.requestFrame();
  }

  setPurposes(purposes: ReadonlySet<Purpose>): void {
    this.content.setPurposes(purposes);
    this.boundsAreOld = true;
  }

  setPeople(people: Person[]): void {
    this.people = people;
    this.marksAreOld = true;
    this.requestFrame();
  }

  setSelection(paths: string[]): void {
    this.selection = paths;
    this.marksAreOld = true;
    this.attachGizmo();
    this.requestFrame();
  }

  setGizmo(mode: GizmoMode | undefined): void {
    this.gizmoMode = mode;
    if (mode) this.gizmo.mode = mode;
    this.attachGizmo();
  }

  /** Keeps the camera at that of a person, until the person of this page moves it. */
  follow(id: string | undefined): void {
    this.followed = id;
    this.marksAreOld = true;
    this.requestFrame();
  }

  /** Looks through a camera of the stage, or with the free camera again. */
  lookThrough(path: string | undefined): void {
    const id = path === undefined ? undefined : this.store.idOf(path);
    this.stageCamera = id !== undefined && this.store.items.get(id)?.camera ? id : undefined;
    this.orbit.enabled = this.stageCamera === undefined;
    this.requestFrame();
  }

  /** Moves the camera so that these prims, or without paths all, fill the picture. */
  frameOn(paths: string[]): void {
    const items = paths.length > 0 ? paths.flatMap((path) => [...this.store.below(path)]) : this.store.items.values();
    const box = this.content.box(items);
    if (box.isEmpty()) return;
    this.isAutoFraming = false;
    this.fit(box);
    this.requestFrame();
  }

  problemOf(path: string): string | undefined {
    const item = this.store.items.get(this.store.idOf(path) ?? 0);
    return item && this.content.problemOf(item);
  }

  /** The place of a prim's middle in the picture, in CSS pixels, and whether everything it needs is here. */
  placeOf(path: string): { x: number; y: number } | undefined {
    const box = this.content.box(this.store.below(path));
    if (box.isEmpty()) return undefined;
    const at = box.getCenter(new Vector3()).project(this.activeCamera());
    const { width, height, left, top } = this.renderer.domElement.getBoundingClientRect();
    return { x: left + ((at.x + 1) / 2) * width, y: top + ((1 - at.y) / 2) * height };
  }

  /** Whether the pointer is at a handle of the gizmo. */
  get isAtHandle(): boolean {
    return this.gizmo.isHovered;
  }

  get isSettled(): boolean {
    return this.isComplete && this.content.shapes.pending === 0 && !this.isRequested;
  }

  private listen(canvas: HTMLCanvasElement): void {
    const down = new Vector2();
    canvas.addEventListener("pointerdown", (event) => down.set(event.clientX, event.clientY));
    canvas.addEventListener("pointerup", (event) => {
      const distance = down.distanceTo(new Vector2(event.clientX, event.clientY));
      if (event.button === 0 && distance < CLICK_PIXELS && !this.gizmo.isHovered) this.pick(event);
    });
    canvas.addEventListener("keydown", (event) => this.pressed(event));
    canvas.addEventListener("webglcontextrestored", () => this.requestFrame());
  }

  private pressed(event: KeyboardEvent): void {
    const turns: Record<string, [number, number]> = {
      ArrowLeft: [-0.1, 0],
      ArrowRight: [0.1, 0],
      ArrowUp: [0, -0.1],
      ArrowDown: [0, 0.1],
    };
    const turn = turns[event.key];
    const zoom = event.key === "+" || event.key === "=" ? 0.9 : event.key === "-" ? 1 / 0.9 : undefined;
    if (event.ctrlKey || event.metaKey || event.altKey || (!turn && zoom === undefined)) return;
    event.preventDefault();
    this.navigated();
    const offset = this.camera.position.clone().sub(this.orbit.target);
    if (turn) {
      offset.applyAxisAngle(this.camera.up, -turn[0]);
      const side = new Vector3().crossVectors(this.camera.up, offset).normalize();
      const tilted = offset.clone().applyAxisAngle(side, turn[1]);
      const angle = tilted.angleTo(this.camera.up);
      if (angle > 0.05 && angle < Math.PI - 0.05) offset.copy(tilted);
    }
    offset.multiplyScalar(zoom ?? 1);
    this.camera.position.copy(this.orbit.target).add(offset);
    this.orbit.update();
    this.requestFrame();
  }

  private navigated(): void {
    this.isAutoFraming = false;
    this.followed = undefined;
    this.stageCamera = undefined;
    this.orbit.enabled = true;
    this.handler.navigated();
  }

  private pick(event: PointerEvent): void {
    const rect = this.renderer.domElement.getBoundingClientRect();
    const at = new Vector2(
      ((event.clientX - rect.left) / rect.width) * 2 - 1,
      1 - ((event.clientY - rect.top) / rect.height) * 2,
    );
    const ray = new Raycaster();
    ray.setFromCamera(at, this.activeCamera());
    ray.params.Line.threshold = ray.params.Points.threshold = this.bounds.radius * 0.01;
    const hit = ray.intersectObjects(this.content.root.children, false)[0];
    const id = hit && this.content.ownerOf(hit.object, hit.instanceId);
    const isAdded = event.ctrlKey || event.metaKey || event.shiftKey;
    this.handler.picked(id === undefined ? undefined : this.store.items.get(id)?.path, isAdded);
  }

  private attachGizmo(): void {
    const path = this.selection.at(-1);
    const id = path === undefined || this.gizmoMode === undefined ? undefined : this.store.idOf(path);
    this.gizmo.attach(id);
  }

  private frame(): void {
    this.isRequested = false;
    const start = performance.now();
    this.resize();
    this.applyChanges(start);
    this.followPerson();
    if (this.marksAreOld) this.updateMarks();
    const camera = this.activeCamera();
    this.gizmo.camera = camera;
    this.frustums.hideNear(camera);
    this.gizmo.follow();
    this.content.setLens(camera.projectionMatrix.elements[5] as number);
    this.scene.updateMatrixWorld();
    this.renderer.clear();
    this.renderer.render(this.scene, camera);
    this.outlines.render(this.renderer, camera);
    this.labels.update(this.marks, camera, this.host.clientWidth, this.host.clientHeight);
    this.tellCamera(camera);
    if (!this.hasEnvironment && this.isAnyMetal()) this.addEnvironment();
    this.stats.frames++;
    this.stats.draws = this.content.draws;
    this.stats.milliseconds.push(performance.now() - start);
    if (this.stats.milliseconds.length > 600) this.stats.milliseconds.shift();
  }

  private isAnyMetal(): boolean {
    for (const { metallic, textures } of this.store.materials.values())
      if ((metallic ?? 0) > 0.1 || textures?.metallic) return true;
    return false;
  }

  /** Only metals need surroundings. They come after the first picture, which is there earlier without them. */
  private addEnvironment(): void {
    this.hasEnvironment = true;
    requestAnimationFrame(() => {
      this.scene.environment = makeEnvironment(this.renderer);
      this.scene.environmentIntensity = 0.35;
      this.requestFrame();
    });
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.host;
    const size = this.renderer.getSize(new Vector2());
    if (size.x === clientWidth && size.y === clientHeight) return;
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / Math.max(1, clientHeight);
    this.camera.updateProjectionMatrix();
  }

  private applyChanges(now: number): void {
    if (this.store.isChanged || this.content.isStale) {
      const changes = this.store.takeChanges();
      const isOther = this.content.apply(changes);
      if (isOther) {
        this.lightsAreOld = true;
        this.boundsAreOld = true;
        this.attachGizmo();
      }
      this.marksAreOld ||= isOther || this.isAnyMarked(changes.moved);
      this.lightsAreOld ||= this.isAnyLight(changes.moved);
    }
    // A box of everything costs in proportion to the scene: it is good enough when it is a second old.
    if (this.boundsAreOld && (this.isAutoFraming || now - this.boundsTime > 1000)) {
      this.boundsAreOld = false;
      this.boundsTime = now;
      this.measure();
    }
    if (this.lightsAreOld) {
      this.lightsAreOld = false;
      this.lights.update(this.store, this.bounds.center);
    }
    this.camera.near = Math.max(this.bounds.radius * 1e-4, this.camera.position.distanceTo(this.orbit.target) * 5e-3);
    this.camera.far =
      this.camera.position.distanceTo(this.bounds.center) + 4 * this.bounds.radius + 10 * this.camera.near;
    this.camera.updateProjectionMatrix();
  }

  private measure(): void {
    const box = this.content.box(this.store.items.values());
    if (box.isEmpty()) box.set(new Vector3(-1, -1, -1), new Vector3(1, 1, 1));
    box.getBoundingSphere(this.bounds);
    this.updateGrid(box);
    if (!this.isAutoFraming) return;
    this.fit(box);
    if (this.isComplete && this.content.shapes.pending === 0 && this.store.items.size > 0) this.isAutoFraming = false;
  }

  private updateGrid(box: Box3): void {
    const step = 10 ** Math.round(Math.log10(Math.max(this.bounds.radius, 1e-6) / 4));
    const size = step * 2 * Math.max(10, Math.ceil((1.6 * this.bounds.radius) / step));
    const isY = this.camera.up.y === 1;
    if (this.grid && this.grid.userData.size === size && this.grid.userData.isY === isY) return;
    if (this.grid) {
      this.scene.remove(this.grid);
      this.grid.dispose();
    }
    const [strong, weak] = this.isDark ? [0x46505f, 0x2a313b] : [0xb4bcc8, 0xd5dae2];
    this.grid = new GridHelper(size, Math.round(size / step), strong, weak);
    this.grid.material.depthWrite = false;
    this.grid.material.toneMapped = false;
    this.grid.renderOrder = -1;
    this.grid.userData = { size, isY };
    if (!isY) this.grid.rotation.x = Math.PI / 2;
    const center = box.getCenter(new Vector3());
    const round = (value: number) => Math.round(value / step) * step;
    this.grid.position.set(round(center.x), isY ? 0 : round(center.y), isY ? round(center.z) : 0);
    this.scene.add(this.grid);
  }

  /** Moves the camera back or forth, in the direction from which it looks, until the box just fills the picture. */
  private fit(box: Box3): void {
    const center = box.getCenter(new Vector3());
    const back = this.camera.position.clone().sub(this.orbit.target);
    if (back.lengthSq() === 0) back.set(1, 0.7, 1.4);
    back.normalize();
    const right = new Vector3().crossVectors(this.camera.up, back).normalize();
    const up = new Vector3().crossVectors(back, right);
    const tall = Math.tan((FIELD_OF_VIEW / 2) * (Math.PI / 180));
    const wide = tall * this.camera.aspect;
    let distance = 1e-3;
    for (let corner = 0; corner < 8; corner++) {
      const x = corner & 1 ? box.max.x : box.min.x;
      const y = corner & 2 ? box.max.y : box.min.y;
      const z = corner & 4 ? box.max.z : box.min.z;
      const at = new Vector3(x, y, z).sub(center);
      const needed = Math.max(Math.abs(at.dot(right)) / wide, Math.abs(at.dot(up)) / tall);
      distance = Math.max(distance, needed + at.dot(back));
    }
    this.orbit.target.copy(center);
    this.camera.position.copy(center).addScaledVector(back, FIT_MARGIN * distance);
    this.camera.near = distance / 1000;
    this.camera.far = distance * 10;
    this.camera.updateProjectionMatrix();
    this.orbit.update();
  }

  private followPerson(): void {
    const person = this.people.find(({ id }) => id === this.followed);
    const matrix = person && cameraOf(person);
    if (!matrix) return;
    this.isAutoFraming = false;
    const distance = Math.max(this.camera.position.distanceTo(this.orbit.target), this.bounds.radius * 0.1);
    const turn = new Quaternion();
    matrix.decompose(this.camera.position, turn, new Vector3());
    this.orbit.target.copy(this.camera.position).add(new Vector3(0, 0, -distance).applyQuaternion(turn));
    this.orbit.update();
  }

  private updateMarks(): void {
    this.marksAreOld = false;
    const outlined: Outlined[] = [];
    this.marks = this.frustums.update(this.people, this.bounds.radius * 0.12, this.followed);
    for (const { id, user, color, selection } of this.people) {
      for (const path of selection.slice(0, 50)) {
        outlined.push(...this.content.outlined(path, color, MOST_OUTLINED));
        const box = this.content.box(this.store.below(path));
        if (box.isEmpty()) continue;
        const place = box.getCenter(new Vector3());
        if (this.camera.up.y === 1) place.y = box.max.y;
        else place.z = box.max.z;
        this.marks.push({ key: `${id} ${path}`, text: user, color, place });
      }
    }
    for (const path of this.selection.slice(0, 200))
      outlined.push(...this.content.outlined(path, OWN_COLOR, MOST_OUTLINED));
    this.outlines.set(outlined);
  }

  private isAnyMarked(ids: ReadonlySet<PrimId>): boolean {
    const marked = [...this.selection, ...this.people.flatMap(({ selection }) => selection)];
    if (marked.length === 0) return false;
    for (const id of ids) {
      const path = this.store.items.get(id)?.path ?? "";
      if (marked.some((one) => path === one || path.startsWith(`${one}/`))) return true;
    }
    return false;
  }

  private isAnyLight(ids: ReadonlySet<PrimId>): boolean {
    for (const id of ids) if (this.store.items.get(id)?.kind === "light") return true;
    return false;
  }

  private activeCamera(): Camera {
    const item = this.stageCamera === undefined ? undefined : this.store.items.get(this.stageCamera);
    if (!item?.camera) return this.camera;
    const camera = cameraFor(item.camera, this.host.clientWidth / Math.max(1, this.host.clientHeight));
    worldMatrix(this.store, item.id).decompose(camera.position, camera.quaternion, new Vector3());
    camera.updateMatrixWorld();
    return camera;
  }

  private tellCamera(camera: Camera): void {
    if (this.followed !== undefined || camera.matrixWorld.equals(this.sent)) return;
    this.sent.copy(camera.matrixWorld);
    this.handler.cameraMoved(camera.matrixWorld.toArray());
  }
}

/** A camera that shows at least the aperture of a camera of USD. Apertures are in tenths of a unit of the scene. */
function cameraFor(shape: CameraShape, aspect: number): PerspectiveCamera | OrthographicCamera {
  const near = Math.max(shape.near, 1e-4);
  const far = Math.max(shape.far, near * 2);
  const height = Math.max(shape.vAperture, shape.hAperture / aspect);
  if (shape.projection === "orthographic") {
    const half = height / 20;
    return new OrthographicCamera(-half * aspect, half * aspect, half, -half, near, far);
  }
  return new PerspectiveCamera((2 * Math.atan(height / (2 * shape.focal)) * 180) / Math.PI, aspect, near, far);
}
