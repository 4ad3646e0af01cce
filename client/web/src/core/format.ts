// Writes times, numbers and matrices for people, and reads what they type.
import type { Json } from "./protocol";

/** Seconds since 1970, or a text that says the time. */
export function dateOf(at: string | number | null | undefined): Date | undefined {
  if (at === null || at === undefined || at === "") return undefined;
  const date = typeof at === "number" ? new Date(at < 1e11 ? at * 1000 : at) : new Date(at);
  return Number.isNaN(date.getTime()) ? undefined : date;
}

/** "just now", "5 min ago", "3 h ago", and the day for what is older. */
export function ago(at: string | number | null | undefined, now = Date.now()): string {
  const date = dateOf(at);
  if (!date) return "";
  const seconds = Math.max(0, (now - date.getTime()) / 1000);
  if (seconds < 45) return "just now";
  if (seconds < 3600) return `${Math.max(1, Math.round(seconds / 60))} min ago`;
  if (seconds < 86_400) return `${Math.round(seconds / 3600)} h ago`;
  return date.toISOString().slice(0, 10);
}

/** A number with at most 6 significant digits. */
export function short(value: number): string {
  if (!Number.isFinite(value)) return String(value);
  return String(Number(value.toPrecision(6)));
}

const clampByte = (value: number) => Math.round(Math.min(1, Math.max(0, value || 0)) * 255);

/** Linear color of USD to the "#rrggbb" of a browser, which is sRGB. */
export function hexOfLinear(color: readonly number[]): string {
  const encode = (value: number) => (value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055);
  return `#${[0, 1, 2]
    .map((index) =>
      clampByte(encode(Math.max(0, color[index] || 0)))
        .toString(16)
        .padStart(2, "0"),
    )
    .join("")}`;
}

export function linearOfHex(hex: string): [number, number, number] {
  const decode = (at: number) => {
    const value = Number.parseInt(hex.slice(at, at + 2), 16) / 255;
    return Number((value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4).toPrecision(6));
  };
  return [decode(1), decode(3), decode(5)];
}

export type Widget = "bool" | "number" | "integer" | "token" | "color" | "vector" | "string" | "asset" | "none";

const VECTOR = /^(?:float|double|half|int|point|vector|normal|texCoord)([234])[dfhi]?$/;
const COLOR = /^color[34][dfh]$/;
const QUATERNION = /^quat[dfh]$/;

/** The widget that edits a value of this type, and the number of its components. */
export function widgetFor(type: string, allowed: readonly string[]): { widget: Widget; size: number } {
  if (type === "bool") return { widget: "bool", size: 1 };
  if (["float", "double", "half", "timecode"].includes(type)) return { widget: "number", size: 1 };
  if (["int", "uint", "int64", "uint64", "uchar"].includes(type)) return { widget: "integer", size: 1 };
  if (type === "token") return { widget: allowed.length > 0 ? "token" : "string", size: 1 };
  if (type === "string") return { widget: "string", size: 1 };
  if (type === "asset") return { widget: "asset", size: 1 };
  if (COLOR.test(type)) return { widget: "color", size: Number(type[5]) };
  const vector = VECTOR.exec(type);
  if (vector) return { widget: "vector", size: Number(vector[1]) };
  if (QUATERNION.test(type)) return { widget: "vector", size: 4 };
  return { widget: "none", size: 0 };
}

/** The numbers in a JSON value, or undefined if it is not a list of `size` numbers. */
export function numbersOf(value: Json | undefined, size: number): number[] | undefined {
  if (!Array.isArray(value) || value.length !== size) return undefined;
  return value.every((one) => typeof one === "number") ? (value as number[]) : undefined;
}

/** The number that a person typed, or undefined. A comma is a decimal point, too. */
export function numberOf(text: string, isInteger: boolean): number | undefined {
  const value = Number(text.trim().replace(",", "."));
  if (text.trim() === "" || !Number.isFinite(value)) return undefined;
  return isInteger && !Number.isInteger(value) ? undefined : value;
}

/** Two letters for a person. */
export function initials(name: string): string {
  const words = name.split(/[\s._@-]+/).filter(Boolean);
  const letters =
    words.length > 1 ? (words[0] as string).slice(0, 1) + (words[1] as string).slice(0, 1) : name.slice(0, 2);
  return letters.toUpperCase();
}

/** The last part of a path of a layer or prim. */
export const lastOf = (path: string): string => path.slice(path.lastIndexOf("/") + 1) || path;
