// Makes three.js materials of UsdPreviewSurface, with textures that arrive later.
import {
  ClampToEdgeWrapping,
  Color,
  DoubleSide,
  FrontSide,
  LinearSRGBColorSpace,
  MeshPhysicalMaterial,
  MeshStandardMaterial,
  MirroredRepeatWrapping,
  RepeatWrapping,
  SRGBColorSpace,
  type Texture,
  TextureLoader,
  type Material as ThreeMaterial,
  type Wrapping,
} from "three";
import type { Material, TextureRole, TextureUse, Vec3, WrapMode } from "../core/protocol";

/** Properties of a mesh that its material needs. */
export interface Variant {
  isFlat: boolean;
  hasColors: boolean;
  isDoubleSided: boolean;
  opacity: number;
}

const WRAPPING: Record<WrapMode, Wrapping> = {
  repeat: RepeatWrapping,
  clamp: ClampToEdgeWrapping,
  mirror: MirroredRepeatWrapping,
  black: ClampToEdgeWrapping,
};
const DEGREES = Math.PI / 180;

export const linear = (color: Vec3): Color => new Color().setRGB(color[0], color[1], color[2], LinearSRGBColorSpace);

export class MaterialLibrary {
  private readonly made = new Map<string, ThreeMaterial>();
  private readonly textures = new Map<string, Texture>();
  private readonly loader = new TextureLoader();
  private readonly versions = new Map<string, number>();
  /** Textures that this browser cannot show, with the reason. */
  readonly problems = new Map<string, string>();

  /** `changed` is called when a texture arrived. */
  constructor(
    private readonly describe: (hash: string) => Material | undefined,
    private readonly changed: () => void,
  ) {}

  get(hash: string, variant: Variant): ThreeMaterial {
    const key = `${hash}|${variant.isFlat}|${variant.hasColors}|${variant.isDoubleSided}|${variant.opacity}`;
    const known = this.made.get(key);
    if (known) return known;
    const material = this.make(this.describe(hash), variant);
    this.made.set(key, material);
    return material;
  }

  /** A number that changes when the material was described anew: what is drawn with it belongs into another group then. */
  version(hash: string): number {
    return this.versions.get(hash) ?? 0;
  }

  /** Forgets a material that was described anew. */
  forget(hash: string): void {
    this.versions.set(hash, this.version(hash) + 1);
    for (const [key, material] of this.made) {
      if (!key.startsWith(`${hash}|`)) continue;
      material.dispose();
      this.made.delete(key);
    }
  }

  private make(from: Material | undefined, variant: Variant): ThreeMaterial {
    const isGlass = (from?.ior ?? 1.5) !== 1.5;
    const material = isGlass
      ? new MeshPhysicalMaterial({ ior: clamp(from?.ior ?? 1.5, 1, 2.333) })
      : new MeshStandardMaterial();
    material.roughness = clamp(from?.roughness ?? 0.55, 0, 1);
    material.metalness = clamp(from?.metallic ?? 0, 0, 1);
    material.flatShading = variant.isFlat;
    material.side = variant.isDoubleSided ? DoubleSide : FrontSide;
    const opacity = (from?.opacity ?? 1) * variant.opacity;
    const threshold = from?.opacityThreshold ?? 0;
    if (threshold > 0) material.alphaTest = threshold;
    else if (opacity < 1 || from?.textures?.opacity) {
      material.transparent = true;
      material.depthWrite = false;
    }
    material.opacity = clamp(opacity, 0, 1);
    if (!from) {
      // The display colour comes from the instance, or from the points.
      material.vertexColors = variant.hasColors;
      return material;
    }
    material.color = linear(from.color ?? [0.18, 0.18, 0.18]);
    material.emissive = linear(from.emissive ?? [0, 0, 0]);
    for (const [role, use] of Object.entries(from.textures ?? {})) {
      if (use?.hash) this.addTexture(material, role as TextureRole, use);
    }
    return material;
  }

  private addTexture(material: MeshStandardMaterial, role: TextureRole, use: TextureUse): void {
    const texture = this.texture(use, role === "color" || role === "emissive");
    const scale = use.scale ?? [1, 1, 1, 1];
    switch (role) {
      case "color":
        material.map = texture;
        material.color = linear([scale[0] ?? 1, scale[1] ?? 1, scale[2] ?? 1]);
        break;
      case "normal":
        material.normalMap = texture;
        break;
      case "metallic":
        // three.js reads the blue channel.
        material.metalnessMap = texture;
        material.metalness = 1;
        break;
      case "roughness":
        // three.js reads the green channel.
        material.roughnessMap = texture;
        material.roughness = 1;
        break;
      case "emissive":
        material.emissiveMap = texture;
        material.emissive = new Color(1, 1, 1);
        break;
      case "opacity":
        material.alphaMap = texture;
        break;
      case "occlusion":
        material.aoMap = texture;
        break;
    }
  }

  private texture(use: TextureUse, isColor: boolean): Texture {
    const key = JSON.stringify([use, isColor]);
    const known = this.textures.get(key);
    if (known) return known;
    const texture = this.loader.load(
      `/blob/${use.hash}`,
      () => this.changed(),
      undefined,
      () => {
        this.problems.set(
          use.hash,
          "this browser cannot show the texture: it is missing, or of another format than PNG, JPEG or WebP",
        );
        this.changed();
      },
    );
    texture.colorSpace = (use.srgb ?? isColor) ? SRGBColorSpace : LinearSRGBColorSpace;
    texture.wrapS = WRAPPING[use.wrapS ?? "repeat"];
    texture.wrapT = WRAPPING[use.wrapT ?? "repeat"];
    texture.repeat.set(use.uvScale?.[0] ?? 1, use.uvScale?.[1] ?? 1);
    texture.offset.set(use.translate?.[0] ?? 0, use.translate?.[1] ?? 0);
    texture.rotation = (use.rotate ?? 0) * DEGREES;
    texture.anisotropy = 4;
    this.textures.set(key, texture);
    return texture;
  }
}

const clamp = (value: number, low: number, high: number) =>
  Math.min(high, Math.max(low, Number.isFinite(value) ? value : low));
