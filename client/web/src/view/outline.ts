// Draws coloured outlines around what people have selected: a mask of the selected shapes, and its edges over the picture.
import {
  type BufferGeometry,
  type Camera,
  Color,
  DoubleSide,
  LineBasicMaterial,
  LineSegments,
  type Matrix4,
  Mesh,
  MeshBasicMaterial,
  OrthographicCamera,
  PlaneGeometry,
  Points,
  PointsMaterial,
  Scene,
  ShaderMaterial,
  Vector2,
  type WebGLRenderer,
  WebGLRenderTarget,
} from "three";

export interface Outlined {
  geometry: BufferGeometry;
  kind: "mesh" | "curves" | "points";
  matrix: Matrix4;
  color: string;
}

const VERTEX = `
varying vec2 place;
void main() { place = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }`;

// A pixel outside the mask with a pixel of the mask near it belongs to the outline.
const FRAGMENT = `
uniform sampler2D mask;
uniform vec2 pixel;
varying vec2 place;
void main() {
  vec4 here = texture2D(mask, place);
  vec4 near = vec4(0.0);
  for (int i = 0; i < 12; i++) {
    float angle = float(i) * 0.5235988;
    vec4 found = texture2D(mask, place + vec2(cos(angle), sin(angle)) * pixel * 2.2);
    if (found.a > near.a) near = found;
  }
  if (here.a > 0.5) gl_FragColor = vec4(here.rgb, 0.10);
  else if (near.a > 0.5) gl_FragColor = vec4(near.rgb, 1.0);
  else discard;
  #include <colorspace_fragment>
}`;

export class Outlines {
  private readonly scene = new Scene();
  private readonly target = new WebGLRenderTarget(1, 1, { depthBuffer: false });
  private readonly uniforms = { mask: { value: this.target.texture }, pixel: { value: new Vector2() } };
  private readonly quadScene = new Scene();
  private readonly quadCamera = new OrthographicCamera();
  private readonly materials = new Map<string, MeshBasicMaterial | LineBasicMaterial | PointsMaterial>();

  constructor() {
    const material = new ShaderMaterial({
      uniforms: this.uniforms,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      transparent: true,
      depthTest: false,
      depthWrite: false,
    });
    const quad = new Mesh(new PlaneGeometry(2, 2), material);
    quad.frustumCulled = false;
    this.quadScene.add(quad);
  }

  /** Replaces what is outlined. Later ones are drawn over earlier ones. */
  set(outlined: Outlined[]): void {
    this.scene.clear();
    for (const { geometry, kind, matrix, color } of outlined) {
      const object =
        kind === "mesh"
          ? new Mesh(geometry, this.material(kind, color))
          : kind === "curves"
            ? new LineSegments(geometry, this.material(kind, color))
            : new Points(geometry, this.material(kind, color));
      object.matrixAutoUpdate = false;
      object.matrix.copy(matrix);
      object.renderOrder = this.scene.children.length;
      this.scene.add(object);
    }
  }

  render(renderer: WebGLRenderer, camera: Camera): void {
    if (this.scene.children.length === 0) return;
    const size = renderer.getDrawingBufferSize(new Vector2());
    if (this.target.width !== size.x || this.target.height !== size.y) this.target.setSize(size.x, size.y);
    const ratio = renderer.getPixelRatio();
    this.uniforms.pixel.value.set(ratio / size.x, ratio / size.y);
    const clearColor = renderer.getClearColor(new Color());
    const clearAlpha = renderer.getClearAlpha();
    renderer.setRenderTarget(this.target);
    renderer.setClearColor(0, 0);
    renderer.clear();
    renderer.render(this.scene, camera);
    renderer.setRenderTarget(null);
    renderer.setClearColor(clearColor, clearAlpha);
    renderer.render(this.quadScene, this.quadCamera);
  }

  private material(kind: Outlined["kind"], color: string): MeshBasicMaterial | LineBasicMaterial | PointsMaterial {
    const key = `${kind}|${color}`;
    const known = this.materials.get(key);
    if (known) return known;
    const options = { color, toneMapped: false, depthTest: false, depthWrite: false };
    const material =
      kind === "mesh"
        ? new MeshBasicMaterial({ ...options, side: DoubleSide })
        : kind === "curves"
          ? new LineBasicMaterial(options)
          : new PointsMaterial({ ...options, size: 5, sizeAttenuation: false });
    this.materials.set(key, material);
    return material;
  }
}
