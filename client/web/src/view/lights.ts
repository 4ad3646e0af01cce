// Approximates the lights of a stage. Their units reach over many orders of magnitude, so the brightest decides the exposure.
import { AmbientLight, Color, DirectionalLight, HemisphereLight, type Object3D, PointLight, Vector3 } from "three";
import type { Item, LightShape } from "../core/protocol";
import type { SceneStore } from "../core/scene";

/** Each light costs every pixel; the strongest are kept. */
const MOST_LIGHTS = 8;
const BRIGHTEST = 2.6;
/** The light of the sky where the stage has no lights. */
const FILL = 0.75;

interface Strength {
  item: Item;
  light: LightShape;
  /** The illumination at the middle of the scene. */
  value: number;
}

export class Lights {
  private readonly made: Object3D[] = [];
  private readonly key = new DirectionalLight(0xffffff, 2.3);
  private readonly fill = new HemisphereLight(0xffffff, 0x8a8580, FILL);

  constructor(
    private readonly parent: Object3D,
    camera: Object3D,
  ) {
    this.key.position.set(0.45, 0.8, 1);
    camera.add(this.key, this.key.target);
    this.key.target.position.set(0, 0, -1);
    parent.add(this.fill);
  }

  setUp(up: "Y" | "Z"): void {
    this.fill.position.set(0, up === "Y" ? 1 : 0, up === "Y" ? 0 : 1);
  }

  update(store: SceneStore, center: Vector3): void {
    for (const light of this.made) this.parent.remove(light);
    this.made.length = 0;
    const strengths = [...store.items.values()].flatMap((item) => this.strength(store, item, center));
    strengths.sort((one, other) => other.value - one.value);
    const strongest = strengths.slice(0, MOST_LIGHTS);
    const sum = strongest.reduce((total, { value }) => total + value, 0);
    this.key.visible = sum <= 0;
    this.fill.intensity = sum > 0 ? FILL / 4 : FILL;
    if (sum <= 0) return;
    for (const { item, light, value } of strongest) this.add(store, item, light, (BRIGHTEST * value) / sum, center);
  }

  private strength(store: SceneStore, item: Item, center: Vector3): Strength[] {
    const { light } = item;
    if (!light || !store.isShown(item.id)) return [];
    const radiance = (light.intensity ?? 1) * 2 ** (light.exposure ?? 0);
    const distance = Math.max(placeOf(store, item).distanceTo(center), 1e-3);
    const sizes: Record<LightShape["type"], number> = {
      distant: 0.02,
      dome: Math.PI,
      sphere: Math.PI * (light.radius ?? 0.5) ** 2,
      disk: Math.PI * (light.radius ?? 0.5) ** 2,
      rect: (light.width ?? 1) * (light.height ?? 1),
      cylinder: 2 * (light.radius ?? 0.5) * (light.length ?? 1),
    };
    const isFar = light.type === "distant" || light.type === "dome";
    const value = (radiance * sizes[light.type]) / (isFar ? 1 : distance ** 2);
    return value > 0 && Number.isFinite(value) ? [{ item, light, value }] : [];
  }

  private add(store: SceneStore, item: Item, light: LightShape, value: number, center: Vector3): void {
    const color = new Color().setRGB(...(light.color ?? [1, 1, 1]));
    const place = placeOf(store, item);
    let made: Object3D;
    if (light.type === "dome") made = new AmbientLight(color, value);
    else if (light.type === "distant") {
      const directional = new DirectionalLight(color, value);
      // A light of USD shines along its own -Z.
      const world = store.world(item.id);
      directional.position.set(world[6] as number, world[7] as number, world[8] as number);
      directional.target.position.set(0, 0, 0);
      made = directional;
    } else {
      const distance = Math.max(place.distanceTo(center), 1e-3);
      made = new PointLight(color, value * distance ** 2, 0, 2);
      made.position.copy(place);
    }
    this.made.push(made);
    this.parent.add(made);
  }
}

function placeOf(store: SceneStore, item: Item): Vector3 {
  const world = store.world(item.id);
  return new Vector3(world[9], world[10], world[11]);
}
