// Decides what the panel of live sessions shows, and what a merge sends.
import type { Conflict, LiveSession, Merged, Side } from "./protocol";

/** A merge brings a session to the main line, an update the main line to a session. */
export type MergeVerb = "merge" | "update";

/** A merge that a person prepares: what its dry run has found, and the decisions so far. */
export interface Preparation {
  verb: MergeVerb;
  found: Merged;
  takes: ReadonlyMap<string, Side>;
  /** Decides the conflicts that are too many to be shown. */
  others: Side | undefined;
}

export function prepared(verb: MergeVerb, found: Merged, before?: Preparation): Preparation {
  const shown = new Set(found.conflicts.map(({ id }) => id));
  const takes = new Map([...(before?.takes ?? [])].filter(([id]) => shown.has(id)));
  return { verb, found, takes, others: hiddenIn(found) > 0 ? before?.others : undefined };
}

/** The sides that can be taken. A change that the other line refuses cannot be taken over. */
export function sidesOf(verb: MergeVerb, conflict: Conflict): Side[] {
  if (conflict.what !== "refused") return ["main", "session"];
  return [verb === "merge" ? "main" : "session"];
}

export function decided(preparation: Preparation, id: string, side: Side): Preparation {
  return { ...preparation, takes: new Map([...preparation.takes, [id, side]]) };
}

/** Takes one side in all conflicts that can have it. */
export function allDecided(preparation: Preparation, side: Side): Preparation {
  const takes = new Map(preparation.takes);
  for (const conflict of preparation.found.conflicts)
    if (sidesOf(preparation.verb, conflict).includes(side)) takes.set(conflict.id, side);
  return { ...preparation, takes, others: hiddenIn(preparation.found) > 0 ? side : undefined };
}

export function hiddenIn(found: Merged): number {
  return Math.max(0, found.conflictCount - found.conflicts.length);
}

/** How many conflicts have no decision yet. */
export function undecidedIn({ found, takes, others }: Preparation): number {
  const shown = found.conflicts.filter(({ id }) => !takes.has(id)).length;
  return shown + (others === undefined ? hiddenIn(found) : 0);
}

const counted = (count: number, what: string) => `${count.toLocaleString("en")} ${what}${count === 1 ? "" : "s"}`;

/** One sentence about what a dry run has found. */
export function sentenceOf({ verb, found }: Preparation): string {
  const line = verb === "merge" ? "the main line" : "the session";
  const parts = [`${counted(found.edits, "edit")} would be brought to ${line}`];
  if (found.created.length > 0) parts.push(`${counted(found.created.length, "layer")} created`);
  if (found.conflictCount > 0) parts.push(`${counted(found.conflictCount, "conflict")}`);
  if (found.dropped > 0) parts.push(`${counted(found.dropped, "edit")} left out, because ${line} lacks the specs`);
  return isEmpty(found) ? `There is nothing to ${verb}.` : `${parts.join(", ")}.`;
}

/** Whether there is nothing to do, and nothing to tell. */
export function isEmpty(found: Merged): boolean {
  return found.edits + found.created.length + found.conflictCount + found.dropped === 0;
}

/** Tells the result of a merge or an update. */
export function doneOf(verb: MergeVerb, name: string, { edits, revision }: Merged): string {
  if (revision === 0) return `There was nothing to ${verb}.`;
  const where = verb === "merge" ? `${name} was merged into the main line` : `${name} was updated from the main line`;
  return `${where}: ${counted(edits, "edit")}, revision ${revision}.`;
}

/** The content of a conflict on one side. */
export function contentOf(conflict: Conflict, side: Side): string {
  if (conflict.what === "value") return conflict[side] ?? "nothing";
  if (conflict.what === "deleted") return conflict.deletedIn === side ? "deleted it" : "changed it";
  if (conflict.what === "moved") return "renamed or moved it";
  return "stays as it is";
}

/** The state of a session in one or two words; empty if it is simply open. */
export function stateOf({ ended, merged, problem }: LiveSession): string {
  if (problem !== "") return "cannot be opened";
  if (!ended) return merged > 0 ? `merged in #${merged}` : "";
  return merged > 0 ? `merged in #${merged}, ended` : "ended";
}
