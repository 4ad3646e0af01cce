// Declares the messages between the page and the gateway, as docs/page.md describes them.

export type PrimId = number;
export type Json = null | boolean | number | string | Json[] | { [key: string]: Json };
export type Vec3 = [number, number, number];

export type ItemKind = "xform" | "mesh" | "curves" | "points" | "instancer" | "camera" | "light" | "skeleton";
export type Purpose = "default" | "render" | "proxy" | "guide";

export interface CameraShape {
  focal: number;
  hAperture: number;
  vAperture: number;
  near: number;
  far: number;
  projection: "perspective" | "orthographic";
  hOffset?: number;
  vOffset?: number;
}

export interface LightShape {
  type: "distant" | "sphere" | "rect" | "disk" | "dome" | "cylinder";
  color?: Vec3;
  intensity?: number;
  exposure?: number;
  radius?: number;
  width?: number;
  height?: number;
  length?: number;
  angle?: number;
  texture?: string;
}

export interface Subset {
  material: string;
  start: number;
  count: number;
}

/** One prim that the viewport knows. Its matrix has 12 numbers: rows 0 to 3 and columns 0 to 2 of a row-vector matrix. */
export interface Item {
  id: PrimId;
  path: string;
  parent: PrimId;
  kind: ItemKind;
  matrix?: number[];
  resetsStack?: boolean;
  visible?: boolean;
  purpose?: Purpose;
  color?: Vec3;
  opacity?: number;
  geometry?: string;
  material?: string;
  subsets?: Subset[];
  doubleSided?: boolean;
  camera?: CameraShape;
  light?: LightShape;
  instances?: { prototypes: PrimId[] };
  prototypeOf?: PrimId;
  problem?: string;
}

export type TextureRole = "color" | "normal" | "metallic" | "roughness" | "emissive" | "opacity" | "occlusion";
export type WrapMode = "repeat" | "clamp" | "mirror" | "black";

export interface TextureUse {
  hash: string;
  wrapS?: WrapMode;
  wrapT?: WrapMode;
  channel?: "rgb" | "r" | "g" | "b" | "a";
  scale?: number[];
  bias?: number[];
  translate?: number[];
  rotate?: number;
  uvScale?: number[];
  srgb?: boolean;
}

export interface Material {
  hash: string;
  name?: string;
  color?: Vec3;
  opacity?: number;
  metallic?: number;
  roughness?: number;
  emissive?: Vec3;
  ior?: number;
  opacityThreshold?: number;
  problem?: string;
  textures?: Partial<Record<TextureRole, TextureUse>>;
}

export interface Welcome {
  type: "welcome";
  project: string;
  /** The name of the live session that the page shows; empty: the main line. */
  session: string;
  stage: string;
  stages: string[];
  you: { user: string; role: string; mayEdit: boolean; mayAdminister: boolean };
  server: { connected: boolean; revision: number };
  upAxis: "Y" | "Z";
  metersPerUnit: number;
  startTime: number;
  endTime: number;
  timeCodesPerSecond: number;
  time: number | null;
  revision: { first: number; last: number };
}

/** Metadata of the stage, sent when they changed. */
export interface About {
  type: "about";
  upAxis: "Y" | "Z";
  metersPerUnit: number;
  startTime: number;
  endTime: number;
  timeCodesPerSecond: number;
  time: number | null;
}

export interface SceneMessage {
  type: "scene";
  reset?: boolean;
  more?: boolean;
  add?: Item[];
  remove?: PrimId[];
  materials?: Material[];
}

export interface Person {
  id: string;
  user: string;
  application: string;
  color: string;
  selection: string[];
  camera?: number[];
  time?: number;
  viewer?: boolean;
}

export interface LayerNode {
  layer: string;
  children: LayerNode[];
  muted: boolean;
  dirty: boolean;
  lockedBy: string;
  openBy: string[];
  missing: boolean;
}

/** The names of the layers of a stack, each before its sublayers. */
export function namesOf(layers: readonly LayerNode[]): string[] {
  return [...new Set(layers.flatMap(({ layer, children }) => [layer, ...namesOf(children)]))];
}

export interface StateMessage {
  type: "state";
  connected: boolean;
  revision: number;
  time: number | null;
  past: number | null;
  message: string;
  /** The speed with which the past is played; 0 if it is not. */
  playing?: number | boolean;
}

export interface ChangedMessage {
  type: "changed";
  paths: string[];
  structure: boolean;
  revision: number;
  all?: boolean;
}

export interface RefusedMessage {
  type: "refused";
  path: string;
  layer: string;
  message: string;
}

export interface ReplyMessage {
  type: "reply";
  id: number;
  value?: Json;
  error?: { code: string; message: string };
}

export type GatewayMessage =
  | Welcome
  | SceneMessage
  | { type: "presence"; people: Person[] }
  | { type: "layers"; root: string; stack: LayerNode[] }
  | ChangedMessage
  | StateMessage
  | RefusedMessage
  | ReplyMessage
  | { type: "signIn"; message: string }
  | About;

export interface TreeEntry {
  path: string;
  name: string;
  type: string;
  kind: string;
  children: number;
  active: boolean;
  loaded: boolean;
  instance: boolean;
  specifier: string;
  hasVariants: boolean;
}

export interface Opinion {
  layer: string;
  path: string;
  valueText: string;
  author?: string | null;
  at?: string | number | null;
  revision?: number | null;
}

export interface Property {
  name: string;
  type: string;
  value?: Json;
  valueText: string;
  authored: boolean;
  animated: boolean;
  samples: number;
  relationship: boolean;
  targets: string[];
  connections: string[];
  documentation: string;
  allowed: string[];
  opinions: Opinion[];
}

export interface PrimProperties {
  path: string;
  type: string;
  documentation: string;
  /** False for a part of an instance. */
  editable?: boolean;
  metadata: { [key: string]: Json };
  variants: { set: string; selection: string; choices: string[] }[];
  properties: Property[];
}

/** A line of history that a live session is merged with, or the session itself. */
export type Side = "main" | "session";

export interface LiveSession {
  name: string;
  creator: string;
  at: number;
  /** The revision of the main line from which it is. */
  revision: number;
  ended: boolean;
  /** The revision of the main line that has its changes, or 0. */
  merged: number;
  /** Why it cannot be opened; empty: it can. */
  problem: string;
  /** The users that are in it. */
  users: string[];
  /** Starts a gateway that shows it. */
  command: string;
}

/** Something that both lines have changed. */
export interface Conflict {
  id: string;
  what: "value" | "deleted" | "moved" | "refused";
  layer: string;
  path: string;
  field: string | null;
  part: string | null;
  before: string | null;
  main: string | null;
  session: string | null;
  deletedIn: Side | null;
  reason: string;
  mainUser: string;
  sessionUser: string;
}

/** The result of a merge or an update, or of its dry run. */
export interface Merged {
  revision: number;
  edits: number;
  lines: string[];
  created: string[];
  dropped: number;
  conflictCount: number;
  /** The first ones. */
  conflicts: Conflict[];
}

/** Returns the message in a text frame, or undefined if it is none. Messages of unknown types are left to the caller. */
export function parseMessage(text: string): GatewayMessage | undefined {
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch {
    return undefined;
  }
  if (typeof value !== "object" || value === null) return undefined;
  return typeof (value as { type?: unknown }).type === "string" ? (value as GatewayMessage) : undefined;
}
