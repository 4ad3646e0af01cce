// The history: a slider over revisions with checkpoints, the log with filters, and taking commits back.
import { useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect } from "preact/hooks";
import { ago, lastOf } from "../core/format";
import { type Json, namesOf } from "../core/protocol";
import { textOf } from "../state/session";
import { usePage } from "./context";
import { Icon } from "./icons";
import { Question } from "./question";
import { useRefresh } from "./refresh";

interface Commit {
  revision: number;
  user: string;
  application?: string;
  at?: number | string;
  layers?: string[];
  paths?: string[];
  edits?: number;
  text?: string;
  /** The author's own name for the work. */
  label?: string;
}

interface Checkpoint {
  name: string;
  revision: number;
  user?: string;
}

interface Reverted {
  edits?: number;
  lines?: string[];
  kept?: string[];
  revision?: number | null;
}

const PAGE = 50;
const RELOAD_PAUSE_MS = 400;
/** How much faster than people worked their history is played. */
const SPEEDS = [1, 10, 60, 600];

export function HistoryPanel(): JSX.Element {
  const page = usePage();
  const { session } = page;
  const commits = useSignal<Commit[]>([]);
  const hasMore = useSignal(false);
  const checkpoints = useSignal<Checkpoint[]>([]);
  const problem = useSignal("");
  const user = useSignal("");
  const layer = useSignal("");
  const hours = useSignal(0);
  const isOfSelection = useSignal(false);
  const path = isOfSelection.value ? session.selection.value.at(-1) : undefined;
  const filter: { [key: string]: Json } = {
    ...(user.value === "" ? {} : { user: user.value }),
    ...(layer.value === "" ? {} : { layer: layer.value }),
    ...(hours.value === 0 ? {} : { since: `${hours.value}h` }),
    ...(path === undefined ? {} : { path }),
  };

  async function load(before: number | undefined): Promise<void> {
    try {
      const answer = await session.ask("log", { limit: PAGE, ...(before === undefined ? {} : { before }), ...filter });
      const { commits: found, more } = answer as unknown as { commits: Commit[]; more?: boolean };
      commits.value = before === undefined ? found : [...commits.value, ...found];
      hasMore.value = more ?? found.length === PAGE;
      problem.value = "";
    } catch (error) {
      problem.value = textOf(error);
    }
  }

  async function loadCheckpoints(): Promise<void> {
    try {
      checkpoints.value = ((await session.ask("checkpoints")) as unknown as { items: Checkpoint[] }).items;
    } catch {
      checkpoints.value = [];
    }
  }

  const revision = session.state.value?.revision ?? 0;
  const isOpen = session.line.value.state === "open";
  const choice = JSON.stringify(filter);
  useRefresh(
    () => {
      if (!isOpen) return;
      void load(undefined);
      void loadCheckpoints();
    },
    RELOAD_PAUSE_MS,
    [revision, choice, isOpen],
  );

  const users = [
    ...new Set([...commits.value.map((commit) => commit.user), ...(user.value ? [user.value] : [])]),
  ].sort();
  return (
    <div class="history">
      <RevisionSlider checkpoints={checkpoints.value} commits={commits.value} />
      <div class="filters">
        <label>
          By{" "}
          <select
            value={user.value}
            onChange={(event) => {
              user.value = event.currentTarget.value;
            }}
          >
            <option value="">everybody</option>
            {users.map((name) => (
              <option key={name} value={name}>
                {name}
              </option>
            ))}
          </select>
        </label>
        <label>
          In{" "}
          <select
            value={layer.value}
            onChange={(event) => {
              layer.value = event.currentTarget.value;
            }}
          >
            <option value="">all layers</option>
            {namesOf(session.layers.value).map((name) => (
              <option key={name} value={name}>
                {name}
              </option>
            ))}
          </select>
        </label>
        <label>
          Since{" "}
          <select
            value={hours.value}
            onChange={(event) => {
              hours.value = Number(event.currentTarget.value);
            }}
          >
            {[0, 1, 24, 168].map((one) => (
              <option key={one} value={one}>
                {one === 0 ? "the beginning" : one === 1 ? "an hour ago" : `${one / 24} d ago`}
              </option>
            ))}
          </select>
        </label>
        <label>
          <input
            type="checkbox"
            checked={isOfSelection.value}
            onChange={(event) => {
              isOfSelection.value = event.currentTarget.checked;
            }}
          />{" "}
          selected prim only
        </label>
      </div>
      {session.mayEdit && <CheckpointForm done={loadCheckpoints} />}
      {problem.value && <p class="empty bad">{problem.value}</p>}
      {commits.value.length === 0 && !problem.value && <p class="empty">No commit fits.</p>}
      <ol class="commits" aria-label="Commits, the newest first">
        {commits.value.map((commit) => (
          <CommitRow
            key={commit.revision}
            commit={commit}
            checkpoint={checkpoints.value.find((one) => one.revision === commit.revision)?.name}
          />
        ))}
      </ol>
      {hasMore.value && (
        <button type="button" class="small wide" onClick={() => void load(commits.value.at(-1)?.revision)}>
          Show earlier commits
        </button>
      )}
    </div>
  );
}

/** Shows an earlier revision in the picture, and plays from there. */
export function RevisionSlider({
  checkpoints,
  commits,
}: {
  checkpoints: Checkpoint[];
  commits: Commit[];
}): JSX.Element {
  const { session } = usePage();
  const wish = useSignal<number | undefined>(undefined);
  const speed = useSignal(60);
  const isPlaying = Boolean(session.state.value?.playing);
  const { first, last } = session.welcome.value?.revision ?? { first: 0, last: 0 };
  const newest = Math.max(last, session.state.value?.revision ?? 0);
  const past = session.state.value?.past ?? null;
  const shown = wish.value ?? past ?? newest;
  const author = commits.find(({ revision }) => revision === shown);

  useEffect(() => {
    if (wish.value === undefined) return undefined;
    const timer = setTimeout(() => {
      const revision = wish.value;
      wish.value = undefined;
      if (revision !== undefined) void session.edit("past", { revision: revision >= newest ? null : revision }, "");
    }, 120);
    return () => clearTimeout(timer);
  }, [wish.value]);
  async function play(times: number): Promise<void> {
    if (times > 0 && past === null) await session.edit("past", { revision: first }, "");
    await session.edit("play", { speed: times }, "");
  }

  const fraction = (revision: number) => (newest > first ? ((revision - first) / (newest - first)) * 100 : 100);
  return (
    <div class="revisions">
      <div class="revision-line">
        <button
          type="button"
          class="icon-button"
          aria-label={isPlaying ? "Pause" : "Play the history"}
          disabled={past === null && newest <= first}
          onClick={() => void play(isPlaying ? 0 : speed.value)}
        >
          <Icon name={isPlaying ? "pause" : "play"} filled />
        </button>
        <div class="slider">
          <input
            type="range"
            aria-label="Revision"
            aria-valuetext={
              past === null && wish.value === undefined ? `revision ${newest}, live` : `revision ${shown}`
            }
            min={first}
            max={newest}
            value={shown}
            disabled={newest <= first}
            onInput={(event) => {
              wish.value = Number(event.currentTarget.value);
            }}
          />
          {checkpoints
            .filter(({ revision }) => revision >= first && revision <= newest)
            .map(({ name, revision }) => (
              <span
                key={name}
                class="checkpoint-mark"
                style={{ left: `${fraction(revision)}%` }}
                title={`${name} (#${revision})`}
              />
            ))}
        </div>
        <button
          type="button"
          class="small"
          disabled={past === null}
          onClick={() => void session.edit("past", { revision: null }, "")}
        >
          Live
        </button>
      </div>
      <div class="weak revision-text">
        {[`#${shown}`, author?.user, ago(author?.at), past === null && wish.value === undefined && "live"]
          .filter(Boolean)
          .join(" · ")}
        <select
          class="speed"
          aria-label="Speed of the history"
          value={speed.value}
          onChange={(event) => {
            speed.value = Number(event.currentTarget.value);
            if (isPlaying) void play(speed.value);
          }}
        >
          {SPEEDS.map((times) => (
            <option key={times} value={times}>
              {times}×
            </option>
          ))}
        </select>
      </div>
    </div>
  );
}

function CommitRow({ commit, checkpoint }: { commit: Commit; checkpoint: string | undefined }): JSX.Element {
  const page = usePage();
  const { session } = page;
  const reverted = useSignal<Reverted | undefined>(undefined);
  const problem = useSignal("");
  const isBusy = useSignal(false);
  const color = session.people.value.find(({ user }) => user === commit.user)?.color;

  async function revert(dryRun: boolean): Promise<void> {
    isBusy.value = true;
    problem.value = "";
    try {
      const answer = await session.ask("revert", { revisions: [commit.revision], dryRun });
      reverted.value = dryRun ? ((answer ?? {}) as unknown as Reverted) : undefined;
      if (!dryRun) session.notify(`Commit #${commit.revision} was taken back.`);
    } catch (error) {
      problem.value = textOf(error);
    } finally {
      isBusy.value = false;
    }
  }

  const what = commit.label || commit.text || (commit.paths ?? []).map(lastOf).join(", ");
  const isShown = session.state.value?.past === commit.revision;
  return (
    <li class={`commit${isShown ? " shown" : ""}`} data-commit={commit.revision}>
      <div class="commit-head">
        <button
          type="button"
          class="link revision"
          aria-label={`Show revision ${commit.revision}`}
          onClick={() => void session.edit("past", { revision: commit.revision }, "")}
        >
          #{commit.revision}
        </button>
        <span class="commit-user" style={color ? { borderColor: color } : {}}>
          {commit.user || "(file)"}
        </span>
        <span class="weak">{ago(commit.at)}</span>
        {session.mayEdit && commit.user !== "" && (
          <button
            type="button"
            class="small quiet"
            disabled={isBusy.value}
            aria-label={`Revert commit ${commit.revision}`}
            onClick={() => void revert(true)}
          >
            Revert …
          </button>
        )}
      </div>
      <div class="commit-text">
        {checkpoint && (
          <span class="badge flag">
            <Icon name="flag" /> {checkpoint}
          </span>
        )}
        <span title={(commit.paths ?? []).join("\n")}>{what || "no prim"}</span>
        {commit.layers && commit.layers.length > 0 && (
          <span class="weak"> in {commit.layers.map(lastOf).join(", ")}</span>
        )}
      </div>
      {problem.value && <p class="refusal">{problem.value}</p>}
      {reverted.value && (
        <Question
          label={`What a revert of ${commit.revision} does`}
          go={{ text: "Revert", isBusy: isBusy.value, act: () => void revert(false) }}
          leave={{
            text: "Cancel",
            act: () => {
              reverted.value = undefined;
            },
          }}
        >
          <p>{sentenceOf(reverted.value)}</p>
          <ul>
            {(reverted.value.lines ?? []).slice(0, 20).map((line) => (
              <li key={line}>{line}</li>
            ))}
            {(reverted.value.kept ?? []).slice(0, 20).map((line) => (
              <li key={line} class="weak">
                stays: {line}
              </li>
            ))}
          </ul>
        </Question>
      )}
    </li>
  );
}

function sentenceOf({ edits, lines, kept }: Reverted): string {
  const count = edits ?? lines?.length ?? 0;
  const stays = kept?.length ?? 0;
  const goes = count === 1 ? "1 edit goes back" : `${count} edits go back`;
  return stays === 0
    ? `${goes}.`
    : `${goes}, ${stays} ${stays === 1 ? "stays" : "stay"} because others have written since.`;
}

function CheckpointForm({ done }: { done: () => Promise<void> }): JSX.Element {
  const { session } = usePage();
  const name = useSignal("");
  const problem = useSignal("");
  return (
    <form
      class="checkpoint-form"
      onSubmit={(event) => {
        event.preventDefault();
        const content: { [key: string]: Json } = { name: name.value.trim() };
        if (content.name === "") return;
        session
          .ask("checkpoint", content)
          .then(() => {
            name.value = "";
            problem.value = "";
            return done();
          })
          .catch((error: unknown) => {
            problem.value = textOf(error);
          });
      }}
    >
      <input
        class="field"
        placeholder="Name of a checkpoint"
        aria-label="Name of a checkpoint"
        value={name.value}
        onInput={(event) => {
          name.value = event.currentTarget.value;
        }}
      />
      <button type="submit" class="small" disabled={name.value.trim() === ""}>
        <Icon name="flag" /> Set
      </button>
      {problem.value && <p class="refusal">{problem.value}</p>}
    </form>
  );
}
