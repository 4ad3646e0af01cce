// Tests the tree of prims over a stage of the test.
import { expect, test } from "vitest";
import type { TreeEntry } from "../src/core/protocol";
import { TreeModel } from "../src/core/tree";

/** A stage with one prim that has many children, and a deep one. */
class Stage {
  readonly asked: string[] = [];
  many = 1000;
  children(path: string): string[] {
    if (path === "/") return ["/Deep", "/Many"];
    if (path === "/Many") return Array.from({ length: this.many }, (_, index) => `/Many/P${index}`);
    if (path === "/Deep") return ["/Deep/A"];
    if (path === "/Deep/A") return ["/Deep/A/B"];
    return [];
  }
  entry(path: string): TreeEntry {
    const name = path.slice(path.lastIndexOf("/") + 1);
    return {
      path,
      name,
      type: "Xform",
      kind: "",
      children: this.children(path).length,
      active: true,
      loaded: true,
      instance: false,
      specifier: "def",
      hasVariants: false,
    };
  }
  load = async (path: string, from: number, count: number) => {
    this.asked.push(`${path} ${from}`);
    const all = this.children(path);
    return { total: all.length, items: all.slice(from, from + count).map((one) => this.entry(one)) };
  };
}

const settled = () => new Promise((resolve) => setTimeout(resolve));
const names = (model: TreeModel) =>
  model.rows.map((row) => (row.isLoaded ? `${"  ".repeat(row.depth)}${row.entry.name}` : "gap"));

async function opened(): Promise<{ stage: Stage; model: TreeModel }> {
  const stage = new Stage();
  const model = new TreeModel(stage.load, () => undefined);
  model.reset();
  await settled();
  return { stage, model };
}

test("children are loaded when they are needed", async () => {
  const { stage, model } = await opened();
  expect(names(model)).toEqual(["Deep", "Many"]);
  model.expand("/Many");
  await settled();
  expect(model.rows.length).toBe(1002);
  expect(model.rows[300]).toMatchObject({ isLoaded: false, parent: "/Many", position: 298 });
  expect(stage.asked).toEqual(["/ 0", "/Many 0"]);
  model.need(300, 310);
  await settled();
  expect(stage.asked).toEqual(["/ 0", "/Many 0", "/Many 200"]);
  expect(model.rows[300]).toMatchObject({ isLoaded: true, position: 298, siblings: 1000 });
  model.collapse("/Many");
  expect(names(model)).toEqual(["Deep", "Many"]);
});

test("a prim is revealed with its ancestors, also far down a long list", async () => {
  const { model } = await opened();
  expect(await model.reveal("/Deep/A/B")).toBe(2);
  expect(names(model).slice(0, 3)).toEqual(["Deep", "  A", "    B"]);
  expect(await model.reveal("/Many/P450")).toBe(3 + 1 + 450);
  expect(await model.reveal("/Gone/X")).toBe(-1);
});

test("a change loads again what is shown, and what is gone goes", async () => {
  const { stage, model } = await opened();
  model.expand("/Many");
  await settled();
  stage.many = 2;
  stage.asked.length = 0;
  model.invalidate(["/Many"], true, false);
  await settled();
  expect(names(model)).toEqual(["Deep", "Many", "  P0", "  P1"]);
  expect(new Set(stage.asked)).toEqual(new Set(["/ 0", "/Many 0"]));
  stage.many = 0;
  model.invalidate([], false, true);
  await settled();
  expect(names(model)).toEqual(["Deep", "Many"]);
});

test("a failed load says why, and the tree works on", async () => {
  const stage = new Stage();
  let isBroken = false;
  const model = new TreeModel(
    (path, from, count) => (isBroken ? Promise.reject(new Error("no answer")) : stage.load(path, from, count)),
    () => undefined,
  );
  model.reset();
  await settled();
  isBroken = true;
  model.expand("/Many");
  await settled();
  expect([names(model), model.problem]).toEqual([["Deep", "Many"], "no answer"]);
  isBroken = false;
  model.expand("/Many");
  await settled();
  expect([model.rows.length, model.problem]).toEqual([1002, ""]);
});

test("an answer from before a reset is ignored", async () => {
  const stage = new Stage();
  const answers: (() => void)[] = [];
  const model = new TreeModel(
    async (path, from, count) => {
      const { length } = answers;
      await new Promise<void>((resolve) => answers.push(resolve));
      const page = await stage.load(path, from, count);
      return length === 0 ? { total: 1, items: [stage.entry("/Old")] } : page;
    },
    () => undefined,
  );
  model.reset();
  model.reset();
  answers[1]?.();
  await settled();
  answers[0]?.();
  await settled();
  expect(names(model)).toEqual(["Deep", "Many"]);
});

test("a change while a page is loaded is not lost", async () => {
  const { stage, model } = await opened();
  model.expand("/Many");
  await settled();
  model.invalidate(["/Many"], true, false);
  stage.many = 2;
  model.invalidate(["/Many"], true, false);
  await settled();
  expect(names(model)).toEqual(["Deep", "Many", "  P0", "  P1"]);
});
