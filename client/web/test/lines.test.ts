// Tests what the panel of live sessions decides, and when it asks.
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import {
  allDecided,
  contentOf,
  decided,
  doneOf,
  hiddenIn,
  isEmpty,
  prepared,
  sentenceOf,
  sidesOf,
  stateOf,
  undecidedIn,
} from "../src/core/lines";
import type { Conflict, LiveSession, Merged } from "../src/core/protocol";
import { repeat } from "../src/core/repeat";

beforeEach(() => void vi.useFakeTimers());
afterEach(() => void vi.useRealTimers());

const conflict = (id: string, more: Partial<Conflict> = {}): Conflict => ({
  id,
  what: "value",
  layer: "root.usda",
  path: `/World.${id}`,
  field: "default",
  part: null,
  before: "0",
  main: "1",
  session: null,
  deletedIn: null,
  reason: "",
  mainUser: "ada",
  sessionUser: "bo",
  ...more,
});

const found = (conflicts: Conflict[], more: Partial<Merged> = {}): Merged => ({
  revision: 0,
  edits: 2,
  lines: [],
  created: [],
  dropped: 0,
  conflictCount: conflicts.length,
  conflicts,
  ...more,
});

test("a merge waits until each conflict is decided", () => {
  let merge = prepared("merge", found([conflict("a"), conflict("b")]));
  expect(undecidedIn(merge)).toBe(2);
  merge = decided(decided(merge, "a", "main"), "a", "session");
  expect([undecidedIn(merge), [...merge.takes]]).toEqual([1, [["a", "session"]]]);
  expect(undecidedIn(decided(merge, "b", "main"))).toBe(0);
});

test("decisions are kept for conflicts that another dry run finds again, and for no others", () => {
  const before = allDecided(prepared("merge", found([conflict("a"), conflict("b")])), "session");
  const again = prepared("merge", found([conflict("b"), conflict("c")]), before);
  expect([[...again.takes], undecidedIn(again)]).toEqual([[["b", "session"]], 1]);
  expect(undecidedIn(prepared("merge", found([conflict("b")])))).toBe(1);
});

test("conflicts that are not shown count, and only a decision about all decides them", () => {
  const many = found([conflict("a")], { conflictCount: 300 });
  const merge = prepared("merge", many);
  expect([hiddenIn(many), undecidedIn(merge), undecidedIn(decided(merge, "a", "main"))]).toEqual([299, 300, 299]);
  const all = allDecided(merge, "main");
  expect([all.others, undecidedIn(all), undecidedIn(decided(all, "a", "session"))]).toEqual(["main", 0, 0]);
  // Conflicts that are shown are decided one by one: one that comes meanwhile is not among them.
  expect(allDecided(prepared("merge", found([conflict("a")])), "main").others).toBeUndefined();
  expect(prepared("merge", found([conflict("a")]), all).others).toBeUndefined();
  expect(prepared("merge", many, all).others).toBe("main");
});

test("a refused change can be left out only", () => {
  const refused = conflict("a", { what: "refused" });
  expect([sidesOf("merge", refused), sidesOf("update", refused)]).toEqual([["main"], ["session"]]);
  expect(sidesOf("merge", conflict("b"))).toEqual(["main", "session"]);
  const merge = allDecided(prepared("merge", found([refused, conflict("b")])), "session");
  expect([[...merge.takes], undecidedIn(merge)]).toEqual([[["b", "session"]], 1]);
});

test("a dry run is one sentence", () => {
  expect(sentenceOf(prepared("merge", found([])))).toBe("2 edits would be brought to the main line.");
  expect(sentenceOf(prepared("update", found([conflict("a")], { edits: 1, created: ["b.usda"], dropped: 3 })))).toBe(
    "1 edit would be brought to the session, 1 layer created, 1 conflict, 3 edits left out, because the session lacks the specs.",
  );
  const nothing = found([], { edits: 0 });
  expect([isEmpty(nothing), sentenceOf(prepared("update", nothing))]).toEqual([true, "There is nothing to update."]);
  expect(isEmpty(found([conflict("a")], { edits: 0 }))).toBe(false);
  expect(doneOf("merge", "dusk", found([], { revision: 12 }))).toBe(
    "dusk was merged into the main line: 2 edits, revision 12.",
  );
  expect(doneOf("merge", "dusk", nothing)).toBe("There was nothing to merge.");
});

test("each side of a conflict says what it has", () => {
  const sides = (more: Partial<Conflict>) => [
    contentOf(conflict("a", more), "main"),
    contentOf(conflict("a", more), "session"),
  ];
  expect(sides({})).toEqual(["1", "nothing"]);
  expect(sides({ what: "deleted", deletedIn: "session" })).toEqual(["changed it", "deleted it"]);
  expect(sides({ what: "moved" })).toEqual(["renamed or moved it", "renamed or moved it"]);
});

test("the state of a session is told in a few words", () => {
  const one: LiveSession = {
    name: "dusk",
    creator: "ada",
    at: 0,
    revision: 3,
    ended: false,
    merged: 0,
    problem: "",
    users: [],
    command: "",
  };
  expect(
    [one, { ...one, merged: 9 }, { ...one, ended: true }, { ...one, ended: true, merged: 9 }].map(stateOf),
  ).toEqual(["", "merged in #9", "ended", "merged in #9, ended"]);
  expect(stateOf({ ...one, problem: "its store is damaged" })).toBe("cannot be opened");
});

test("a list is asked for again after each answer, while somebody looks", async () => {
  let asked = 0;
  let isWanted = true;
  let answer = () => {};
  const load = () => {
    asked++;
    return new Promise<void>((resolve) => {
      answer = resolve;
    });
  };
  const stop = repeat(load, 1000, () => isWanted);
  await vi.advanceTimersByTimeAsync(5000);
  expect(asked, "nothing is asked while an answer is awaited").toBe(1);
  answer();
  await vi.advanceTimersByTimeAsync(1000);
  expect(asked).toBe(2);
  isWanted = false;
  answer();
  await vi.advanceTimersByTimeAsync(5000);
  expect(asked).toBe(2);
  isWanted = true;
  await vi.advanceTimersByTimeAsync(1000);
  expect(asked).toBe(3);
  stop();
  answer();
  await vi.advanceTimersByTimeAsync(5000);
  expect(asked).toBe(3);
});
