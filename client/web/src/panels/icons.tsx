// The icons of the page, as line drawings of 16 by 16.
import type { JSX } from "preact";

const PATHS = {
  select: "M3 2l9 6-4 1-2 4z",
  translate: "M8 1v14M1 8h14M8 1L6 3M8 1l2 2M8 15l-2-2M8 15l2-2M1 8l2-2M1 8l2 2M15 8l-2-2M15 8l-2 2",
  rotate: "M13 8a5 5 0 1 1-1.6-3.7M13 2v3h-3",
  scale: "M2 9v5h5M2 14l6-6M9 2h5v5M14 2L9 7",
  frame: "M2 5V2h3M11 2h3v3M14 11v3h-3M5 14H2v-3M6 8a2 2 0 1 0 4 0 2 2 0 1 0-4 0",
  camera: "M2 4h8v8H2zM10 7l4-2v6l-4-2",
  eye: "M1 8s2.5-4.5 7-4.5S15 8 15 8s-2.5 4.5-7 4.5S1 8 1 8zM6 8a2 2 0 1 0 4 0 2 2 0 1 0-4 0",
  hidden: "M1 8s2.5-4.5 7-4.5S15 8 15 8s-2.5 4.5-7 4.5S1 8 1 8zM2 14L14 2",
  lock: "M3 7h10v7H3zM5 7V5a3 3 0 0 1 6 0v2",
  unlock: "M3 7h10v7H3zM5 7V5a3 3 0 0 1 5.8-1",
  mute: "M2 6h3l4-3v10l-4-3H2zM11 6l4 4M15 6l-4 4",
  sound: "M2 6h3l4-3v10l-4-3H2zM11.5 6a3 3 0 0 1 0 4",
  play: "M4 2l9 6-9 6z",
  pause: "M4 2h3v12H4zM9 2h3v12H9z",
  undo: "M6 3L3 6l3 3M3 6h6a4 4 0 0 1 0 8H6",
  redo: "M10 3l3 3-3 3M13 6H7a4 4 0 0 0 0 8h3",
  sun: "M8 5a3 3 0 1 0 0 6 3 3 0 1 0 0-6M8 1v1.5M8 13.5V15M1 8h1.5M13.5 8H15M3 3l1 1M12 12l1 1M3 13l1-1M12 4l1-1",
  moon: "M13 10A6 6 0 0 1 6 3a6 6 0 1 0 7 7z",
  search: "M7 2a5 5 0 1 0 0 10A5 5 0 1 0 7 2M11 11l3 3",
  layers: "M8 2l6 3-6 3-6-3zM2 8l6 3 6-3M2 11l6 3 6-3",
  mesh: "M8 1.5l5.5 3v7L8 14.5l-5.5-3v-7zM2.5 4.5L8 8l5.5-3.5M8 8v6.5",
  xform: "M3 13V3M3 13h10M3 13l6-6",
  light: "M5.5 10a4 4 0 1 1 5 0v2h-5zM6 14h4",
  scope: "M2 4h5l1 2h6v8H2z",
  material: "M8 2a6 6 0 1 0 0 12A6 6 0 1 0 8 2M5.5 6.5a3 3 0 0 1 2-1.8",
  prim: "M8 3l5 5-5 5-5-5z",
  instance: "M2 2h8v8H2zM6 10v4h8V6h-4",
  history: "M8 4v4l3 2M2 8a6 6 0 1 0 2-4.5M2 2v3h3",
  people:
    "M6 3a2.5 2.5 0 1 0 0 5 2.5 2.5 0 1 0 0-5M1.5 14a4.5 4.5 0 0 1 9 0M11 3.5a2 2 0 1 1 0 4M12 9.5a4 4 0 0 1 2.5 4",
  close: "M3 3l10 10M13 3L3 13",
  chevron: "M6 4l4 4-4 4",
  warning: "M8 2l6.5 12h-13zM8 7v3M8 12v.5",
  live: "M8 6a2 2 0 1 0 0 4 2 2 0 1 0 0-4M4 4a5.5 5.5 0 0 0 0 8M12 4a5.5 5.5 0 0 1 0 8",
  flag: "M4 14V2h8l-2 3 2 3H4",
} as const;

export type IconName = keyof typeof PATHS;

export function Icon({ name, filled = false }: { name: IconName; filled?: boolean }): JSX.Element {
  return (
    <svg class={filled ? "icon filled" : "icon"} viewBox="0 0 16 16" aria-hidden="true">
      <path d={PATHS[name]} />
    </svg>
  );
}

/** The icon of a type of prim. */
export function iconOf(type: string, isInstance: boolean): IconName {
  if (isInstance) return "instance";
  if (/Light/.test(type)) return "light";
  if (type === "Camera") return "camera";
  if (type === "Material" || type === "Shader" || type === "NodeGraph") return "material";
  if (type === "Scope" || type === "") return "scope";
  if (/Xform|SkelRoot|Skeleton/.test(type)) return "xform";
  if (/Mesh|Cube|Sphere|Cone|Cylinder|Capsule|Plane|Curves|Points|Instancer|GeomSubset/.test(type)) return "mesh";
  return "prim";
}
