// Tests texts, widgets and other small decisions of the panels.
import { expect, test } from "vitest";
import { ago, hexOfLinear, initials, linearOfHex, numberOf, numbersOf, short, widgetFor } from "../src/core/format";
import { parseMessage } from "../src/core/protocol";
import { textOn } from "../src/view/colors";
import { withGaps } from "../src/view/content";

test("each type of value has its widget", () => {
  const widgets = Object.fromEntries(
    [
      "bool",
      "float",
      "int",
      "color3f",
      "double3",
      "point3f",
      "quatf",
      "asset",
      "token",
      "string",
      "matrix4d",
      "float[]",
    ].map((type) => [type, widgetFor(type, []).widget]),
  );
  expect(widgets).toEqual({
    bool: "bool",
    float: "number",
    int: "integer",
    color3f: "color",
    double3: "vector",
    point3f: "vector",
    quatf: "vector",
    asset: "asset",
    token: "string",
    string: "string",
    matrix4d: "none",
    "float[]": "none",
  });
  expect(widgetFor("token", ["a"]).widget).toBe("token");
  expect(widgetFor("texCoord2f", [])).toEqual({ widget: "vector", size: 2 });
});

test("colors survive the way to the browser and back", () => {
  for (const color of [
    [0, 0, 0],
    [1, 1, 1],
    [0.214, 0.0319, 0.533],
  ]) {
    linearOfHex(hexOfLinear(color)).forEach((value, index) => {
      expect(value).toBeCloseTo(color[index] as number, 2);
    });
  }
  expect(hexOfLinear([2, -1, Number.NaN])).toBe("#ff0000");
});

test("numbers are read as a person types them", () => {
  expect(["1.5", " 2 ", "1,5", "1e3", "", "x", "Infinity"].map((text) => numberOf(text, false))).toEqual([
    1.5,
    2,
    1.5,
    1000,
    undefined,
    undefined,
    undefined,
  ]);
  expect(numberOf("1.5", true)).toBeUndefined();
  expect([short(0.1 + 0.2), short(1e-9), short(123456789)]).toEqual(["0.3", "1e-9", "123457000"]);
  expect([numbersOf([1, 2, 3], 3), numbersOf([1, "2", 3], 3), numbersOf(5, 1)]).toEqual([
    [1, 2, 3],
    undefined,
    undefined,
  ]);
});

test("times are told as a person tells them", () => {
  const now = 1_800_000_000_000;
  expect([10, 600, 7200, 200_000].map((seconds) => ago(now / 1000 - seconds, now))).toEqual([
    "just now",
    "10 min ago",
    "2 h ago",
    "2027-01-13",
  ]);
  expect([ago(null), ago("no date")]).toEqual(["", ""]);
});

test("texts on the colors of people can be read", () => {
  expect([textOn("#ffffff"), textOn("#101820"), textOn("#ffb020")]).toEqual(["#000000", "#ffffff", "#000000"]);
  expect([initials("ann"), initials("Ben Stone"), initials("a")]).toEqual(["AN", "BS", "A"]);
});

test("triangles in no subset keep the material of the prim", () => {
  const subset = (material: string, start: number, count: number) => ({ material, start, count });
  expect(withGaps([], 36, "m")).toEqual([subset("m", 0, 36)]);
  expect(withGaps([subset("b", 12, 6), subset("a", 0, 6)], 24, "m")).toEqual([
    subset("a", 0, 6),
    subset("m", 6, 6),
    subset("b", 12, 6),
    subset("m", 18, 6),
  ]);
  expect(withGaps([subset("a", 0, 99), subset("b", 3, 3)], 6, "m")).toEqual([subset("a", 0, 6)]);
});

test("what is no message is none", () => {
  expect(["", "5", "null", "{}", '{"type": 1}', "{"].map(parseMessage)).toEqual(new Array(6).fill(undefined));
  expect(parseMessage('{"type": "presence", "people": []}')).toEqual({ type: "presence", people: [] });
});
