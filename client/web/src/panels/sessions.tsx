// The live sessions of the project: a list that follows, and what editors do with them.
import { type Signal, useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { ago } from "../core/format";
import {
  allDecided,
  contentOf,
  decided,
  doneOf,
  hiddenIn,
  isEmpty,
  type MergeVerb,
  type Preparation,
  prepared,
  sentenceOf,
  sidesOf,
  stateOf,
  undecidedIn,
} from "../core/lines";
import type { Conflict, Json, LiveSession, Merged, Side } from "../core/protocol";
import { repeat } from "../core/repeat";
import { textOf } from "../state/session";
import { usePage } from "./context";
import { Icon } from "./icons";
import { Question } from "./question";

/** Others make and end sessions rarely, and the gateway does not announce it. */
const PAUSE_MS = 2000;
/** A merge reads all commits of both lines since the session began. */
const MERGE_TIMEOUT_MS = 120_000;
const MOST_LINES = 20;

const NAME_OF: Record<Side, string> = { main: "main line", session: "session" };

export function SessionsPanel(): JSX.Element {
  const { session } = usePage();
  const items = useSignal<LiveSession[] | undefined>(undefined);
  const problem = useSignal("");
  const newest = useRef(0);
  const isOpen = session.line.value.state === "open";
  const shown = session.welcome.value?.session ?? "";
  const mayEdit = session.welcome.value?.you.mayEdit === true;

  async function load(): Promise<void> {
    const number = ++newest.current;
    let found = items.peek();
    let why = "";
    try {
      found = ((await session.ask("sessions")) as unknown as { items: LiveSession[] }).items;
    } catch (error) {
      why = textOf(error);
    }
    // An answer that a newer request overtakes may be from before an own change.
    if (number !== newest.current) return;
    items.value = found;
    problem.value = why;
  }

  useEffect(() => (isOpen ? repeat(load, PAUSE_MS, () => !document.hidden) : undefined), [isOpen]);

  return (
    <section class="panel sessions" aria-label="Live sessions">
      <h2>
        Live sessions <span class="count">{items.value?.length ?? ""}</span>
      </h2>
      <p class="shown-line">
        This page shows {shown === "" ? <strong>the main line</strong> : "the live session "}
        {shown !== "" && <strong>{shown}</strong>}.
      </p>
      {mayEdit && <CreateForm done={load} />}
      {problem.value && <p class="empty bad">{problem.value}</p>}
      {items.value?.length === 0 && (
        <p class="empty">There is no live session yet. In one, a group can try an idea beside the main line.</p>
      )}
      <ul class="session-list">
        {(items.value ?? []).map((one) => (
          <SessionRow key={one.name} one={one} mayEdit={mayEdit} isShown={one.name === shown} reload={load} />
        ))}
      </ul>
    </section>
  );
}

/** Creates a session from the newest revision, or from the one that the page shows. */
function CreateForm({ done }: { done: () => Promise<void> }): JSX.Element {
  const { session } = usePage();
  const name = useSignal("");
  const problem = useSignal("");
  const isBusy = useSignal(false);
  // The past of a session has revisions of its own.
  const past = session.welcome.value?.session === "" ? (session.state.value?.past ?? null) : null;
  return (
    <form
      class="session-form"
      onSubmit={(event) => {
        event.preventDefault();
        const wanted = name.value.trim();
        if (wanted === "" || isBusy.value) return;
        void attempt(isBusy, problem, async () => {
          await session.ask("createSession", { name: wanted, ...(past === null ? {} : { revision: past }) });
          name.value = "";
          await done();
        });
      }}
    >
      <input
        class={`field${problem.value ? " bad" : ""}`}
        placeholder="Name of a session"
        aria-label="Name of a session"
        aria-invalid={problem.value !== ""}
        aria-describedby="session-name-problem"
        value={name.value}
        onInput={(event) => {
          name.value = event.currentTarget.value;
          problem.value = "";
        }}
      />
      <button type="submit" class="small" disabled={name.value.trim() === "" || isBusy.value}>
        {past === null ? "Create" : `Create from #${past}`}
      </button>
      <p class="refusal" id="session-name-problem" role="alert" hidden={problem.value === ""}>
        {problem.value}
      </p>
    </form>
  );
}

function SessionRow(props: {
  one: LiveSession;
  mayEdit: boolean;
  isShown: boolean;
  reload: () => Promise<void>;
}): JSX.Element {
  const { session } = usePage();
  const { one, mayEdit, isShown, reload } = props;
  const preparation = useSignal<Preparation | undefined>(undefined);
  const isDeleteAsked = useSignal(false);
  const isCommandShown = useSignal(false);
  const problem = useSignal("");
  const isBusy = useSignal(false);
  const state = stateOf(one);

  const change = (type: string) =>
    attempt(isBusy, problem, async () => {
      isDeleteAsked.value = false;
      await session.ask(type, { name: one.name });
      await reload();
    });

  async function merge(verb: MergeVerb, isDryRun: boolean, isKept: boolean): Promise<Merged> {
    const { takes, others } = preparation.value ?? { takes: new Map<string, Side>(), others: undefined };
    const content: { [key: string]: Json } = {
      name: one.name,
      dryRun: isDryRun,
      keep: isKept,
      takes: Object.fromEntries(takes),
      others: others ?? null,
    };
    return (await session.ask(`${verb}Session`, content, MERGE_TIMEOUT_MS)) as unknown as Merged;
  }

  const prepare = (verb: MergeVerb) =>
    attempt(isBusy, problem, async () => {
      preparation.value = undefined;
      preparation.value = prepared(verb, await merge(verb, true, false));
    });

  const commit = (verb: MergeVerb, isKept: boolean) =>
    attempt(isBusy, problem, async () => {
      try {
        session.notify(doneOf(verb, one.name, await merge(verb, false, isKept)));
        preparation.value = undefined;
      } catch (error) {
        await look(verb);
        throw error;
      } finally {
        await reload();
      }
    });

  /** Shows what there is now, with the decisions so far, after something else was found. */
  async function look(verb: MergeVerb): Promise<void> {
    try {
      preparation.value = prepared(verb, await merge(verb, true, false), preparation.value);
    } catch {
      // The refusal that led here is shown.
    }
  }

  return (
    <li class="session" data-session={one.name}>
      <div class="session-head">
        <span class="session-name" title={one.name}>
          {one.name}
        </span>
        {isShown && <span class="badge here">this page</span>}
        {state && <span class={`badge${one.problem ? " bad" : ""}`}>{state}</span>}
      </div>
      <div class="weak">
        {[
          one.creator && `by ${one.creator}`,
          ago(one.at),
          one.revision > 0 ? `from #${one.revision}` : "from the files",
        ]
          .filter(Boolean)
          .join(" · ")}
      </div>
      {one.users.length > 0 && (
        <div class="weak session-users">
          <span aria-hidden="true">● </span>
          {`In it: ${one.users.join(", ")}`}
        </div>
      )}
      {one.problem && <p class="refusal">{one.problem}</p>}
      <div class="actions">
        {mayEdit && !one.ended && (
          <>
            <Action text="Merge …" of={one.name} isBusy={isBusy.value} act={() => prepare("merge")} />
            <Action text="Update …" of={one.name} isBusy={isBusy.value} act={() => prepare("update")} />
            <Action text="End" of={one.name} isBusy={isBusy.value} act={() => change("endSession")} />
          </>
        )}
        {mayEdit && one.ended && (
          <>
            <Action text="Restore" of={one.name} isBusy={isBusy.value} act={() => change("restoreSession")} />
            <Action
              text="Delete …"
              of={one.name}
              isBusy={isBusy.value}
              act={() => {
                isDeleteAsked.value = true;
              }}
            />
          </>
        )}
        {!one.ended && !isShown && (
          <Action
            text="Open …"
            of={one.name}
            isBusy={false}
            act={() => {
              isCommandShown.value = !isCommandShown.value;
            }}
          />
        )}
      </div>
      {isBusy.value && <p class="weak">The server is asked …</p>}
      {!preparation.value && <Problem text={problem.value} />}
      {isDeleteAsked.value && one.ended && (
        <Question
          label={`Delete ${one.name}`}
          go={{ text: "Delete", isBusy: isBusy.value, isFinal: true, act: () => void change("deleteSession") }}
          leave={{
            text: "Cancel",
            act: () => {
              isDeleteAsked.value = false;
            },
          }}
        >
          <p>
            Delete <strong>{one.name}</strong> with its history? Nobody can bring it back.
          </p>
        </Question>
      )}
      {isCommandShown.value && !one.ended && <Command one={one} />}
      {preparation.value && (
        <MergeForm
          name={one.name}
          preparation={preparation.value}
          problem={problem.value}
          isBusy={isBusy.value}
          change={(next) => {
            preparation.value = next;
          }}
          commit={commit}
        />
      )}
    </li>
  );
}

function Action(props: { text: string; of: string; isBusy: boolean; act: () => void }): JSX.Element {
  return (
    <button
      type="button"
      class="small"
      disabled={props.isBusy}
      aria-label={`${props.text.replace(" …", "")} ${props.of}`}
      onClick={() => props.act()}
    >
      {props.text}
    </button>
  );
}

function Problem({ text }: { text: string }): JSX.Element | null {
  if (text === "") return null;
  return (
    <p class="refusal" role="alert">
      {text}
    </p>
  );
}

/** A page shows one line; another one has a gateway of its own. */
function Command({ one }: { one: LiveSession }): JSX.Element {
  const { session } = usePage();
  const field = useRef<HTMLInputElement>(null);
  async function copy(): Promise<void> {
    try {
      await navigator.clipboard.writeText(one.command);
      session.notify("The command was copied.");
    } catch {
      // A browser gives the clipboard to encrypted pages and to those of this machine only.
      field.current?.select();
      session.notify("The browser does not let the page copy; the command is selected.");
    }
  }
  return (
    <div class="session-command">
      <p class="weak">This command opens {one.name} in a page of its own:</p>
      <input ref={field} class="field" readOnly aria-label={`Command that opens ${one.name}`} value={one.command} />
      <button
        type="button"
        class="small"
        aria-label={`Copy the command that opens ${one.name}`}
        onClick={() => void copy()}
      >
        Copy
      </button>
    </div>
  );
}

/** Shows the result of a dry run, and takes the decisions about its conflicts. */
function MergeForm(props: {
  name: string;
  preparation: Preparation;
  problem: string;
  isBusy: boolean;
  change: (next: Preparation | undefined) => void;
  commit: (verb: MergeVerb, isKept: boolean) => Promise<void>;
}): JSX.Element {
  const isKept = useSignal(false);
  const { preparation, change } = props;
  const { verb, found } = preparation;
  const undecided = undecidedIn(preparation);
  const hidden = hiddenIn(found);
  const more = found.edits - Math.min(found.lines.length, MOST_LINES);
  const go = {
    text: verb === "merge" ? "Merge" : "Update",
    isBusy: props.isBusy || undecided > 0,
    act: () => void props.commit(verb, isKept.value),
  };
  return (
    <Question
      label={`What ${verb === "merge" ? "a merge" : "an update"} of ${props.name} does`}
      {...(isEmpty(found) ? {} : { go })}
      leave={{ text: isEmpty(found) ? "Close" : "Cancel", act: () => change(undefined) }}
      note={undecided > 0 ? `${undecided.toLocaleString("en")} not decided yet` : ""}
    >
      <p role="status">{sentenceOf(preparation)}</p>
      <ul>
        {found.created.slice(0, MOST_LINES).map((layer) => (
          <li key={layer}>create {layer}</li>
        ))}
        {found.lines.slice(0, MOST_LINES).map((line, index) => (
          <li key={`${index} ${line}`}>{line}</li>
        ))}
        {more > 0 && <li class="weak">and {more.toLocaleString("en")} more</li>}
      </ul>
      {found.conflictCount > 1 && (
        <p class="actions">
          {(["main", "session"] as const).map((side) => (
            <button type="button" key={side} class="small" onClick={() => change(allDecided(preparation, side))}>
              {side === "main" ? "Main line" : "Session"} in all
            </button>
          ))}
        </p>
      )}
      {found.conflicts.map((conflict) => (
        <ConflictRow
          key={conflict.id}
          conflict={conflict}
          sides={sidesOf(verb, conflict)}
          taken={preparation.takes.get(conflict.id)}
          take={(side) => change(decided(preparation, conflict.id, side))}
        />
      ))}
      {hidden > 0 && (
        <p class="weak">
          {hidden.toLocaleString("en")} more conflicts are not shown:{" "}
          {preparation.others === undefined
            ? "take one side in all"
            : `the ${NAME_OF[preparation.others]} counts in them`}
          .
        </p>
      )}
      {verb === "merge" && !isEmpty(found) && (
        <label class="keep">
          <input
            type="checkbox"
            checked={isKept.value}
            onChange={(event) => {
              isKept.value = event.currentTarget.checked;
            }}
          />{" "}
          keep the session open
        </label>
      )}
      <Problem text={props.problem} />
    </Question>
  );
}

function ConflictRow(props: {
  conflict: Conflict;
  sides: Side[];
  taken: Side | undefined;
  take: (side: Side) => void;
}): JSX.Element {
  const { conflict } = props;
  const place = [conflict.path, conflict.field === "default" ? null : conflict.field, conflict.part];
  const users: Record<Side, string> = { main: conflict.mainUser, session: conflict.sessionUser };
  return (
    <fieldset class="conflict" data-conflict={conflict.path}>
      <legend>
        <Icon name="warning" /> {place.filter((one) => one !== null).join(" ")}{" "}
        <span class="weak">in {conflict.layer}</span>
      </legend>
      {conflict.reason && <p class="weak">{conflict.reason}</p>}
      {conflict.what === "value" && <p class="weak">was {conflict.before ?? "nothing"}</p>}
      {props.sides.map((side) => (
        <label key={side}>
          <input
            type="radio"
            name={`conflict ${conflict.id}`}
            checked={props.taken === side}
            onChange={() => props.take(side)}
          />
          <span>
            {NAME_OF[side]}: {contentOf(conflict, side)} {users[side] && <span class="weak">({users[side]})</span>}
          </span>
        </label>
      ))}
    </fieldset>
  );
}

/** Does what a person asks for. What fails is shown where they have asked. */
async function attempt(isBusy: Signal<boolean>, problem: Signal<string>, work: () => Promise<void>): Promise<void> {
  isBusy.value = true;
  problem.value = "";
  try {
    await work();
  } catch (error) {
    problem.value = textOf(error);
  } finally {
    isBusy.value = false;
  }
}
