// The overview: the line to the server, the layers with their states, and who is here.
import { useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { initials, lastOf } from "../core/format";
import type { LayerNode, Person } from "../core/protocol";
import { textOn } from "../view/colors";
import { usePage } from "./context";
import { Icon } from "./icons";

/** The initials are drawn by the style: as a text, they would be another label of a button. */
export function Avatar({ name, color }: { name: string; color: string }): JSX.Element {
  return (
    <span
      class="avatar"
      data-initials={initials(name)}
      style={{ backgroundColor: color, color: textOn(color) }}
      aria-hidden="true"
    />
  );
}

/** One sentence about the line: whether what the page shows is live. */
export function LineState(): JSX.Element {
  const { session } = usePage();
  const line = session.line.value;
  const state = session.state.value;
  let [kind, text]: [string, string] = ["wait", "Connecting"];
  if (line.state === "lost") [kind, text] = ["bad", "Reconnecting"];
  else if (line.state === "refused") [kind, text] = ["bad", "Refused"];
  else if (line.state === "open" && state?.connected === false) [kind, text] = ["bad", "Server away"];
  else if (state?.past != null) [kind, text] = ["past", `Revision ${state.past}`];
  else if (line.state === "open") [kind, text] = ["good", "Live"];
  return (
    <span class={`line-state ${kind}`} role="status" data-state={kind}>
      <span class="dot" aria-hidden="true" />
      {text}
    </span>
  );
}

/** Says what a lost line means for the person, and what happens next. */
export function LineBanner(): JSX.Element | null {
  const page = usePage();
  const { session } = page;
  const line = session.line.value;
  const state = session.state.value;
  if (line.state === "lost") {
    return (
      <Banner kind="bad">
        The gateway does not answer: {line.reason}. The page connects again by itself; what you see may be old.
      </Banner>
    );
  }
  if (line.state === "refused") return null;
  if (line.state === "open" && state?.connected === false) {
    return (
      <Banner kind="bad">
        The server does not answer{state.message ? `: ${state.message}` : ""}. What you see may be old; it becomes live
        again by itself.
      </Banner>
    );
  }
  if (state?.past != null) {
    return (
      <Banner kind="past">
        You see revision {state.past}. Nothing can be edited there.
        <button type="button" class="link" onClick={() => void session.edit("past", { revision: null }, "")}>
          Back to live
        </button>
      </Banner>
    );
  }
  return null;
}

function Banner({ kind, children }: { kind: string; children: preact.ComponentChildren }): JSX.Element {
  return (
    <div class={`banner ${kind}`} role="alert">
      {children}
    </div>
  );
}

export function LayersPanel(): JSX.Element {
  const { session } = usePage();
  const stack = session.layers.value;
  return (
    <section class="panel layers" aria-label="Layers">
      <h2>Layers</h2>
      {stack.length === 0 && <p class="empty">The layers come with the stage.</p>}
      <ul class="layer-list">
        {stack.map((node) => (
          <Layer key={node.layer} node={node} depth={0} />
        ))}
      </ul>
    </section>
  );
}

function Layer({ node, depth }: { node: LayerNode; depth: number }): JSX.Element {
  const { session } = usePage();
  const mayEdit = session.mayEdit;
  const refusal = session.refusals.value.get(layerPlace(node.layer));
  const user = session.welcome.value?.you.user;
  const isLocked = node.lockedBy !== "";
  const state = [
    node.missing && "missing",
    node.muted && "muted",
    node.dirty && "unsaved",
    isLocked && `locked by ${node.lockedBy === user ? "you" : node.lockedBy}`,
    node.openBy.length > 0 && `open: ${node.openBy.join(", ")}`,
  ].filter(Boolean);
  return (
    <li>
      <div
        class={`layer${node.muted ? " muted" : ""}`}
        style={{ paddingLeft: `${8 + 14 * depth}px` }}
        data-layer={node.layer}
      >
        <Icon name="layers" />
        <span class="layer-name" title={node.layer}>
          {lastOf(node.layer)}
        </span>
        {node.dirty && <span class="dirty" title="Has changes that are not in its file" />}
        {node.missing && <span class="badge bad">missing</span>}
        {isLocked && <span class="badge">{node.lockedBy === user ? "you" : node.lockedBy}</span>}
        <button
          type="button"
          class={`icon-button${isLocked ? " on" : ""}`}
          aria-label={`${isLocked ? "Unlock" : "Lock"} ${node.layer}`}
          aria-pressed={isLocked}
          title={isLocked ? `Locked by ${node.lockedBy}` : "Lock: nobody else can edit this layer"}
          disabled={!mayEdit}
          onClick={() => void session.edit("lock", { layer: node.layer, locked: !isLocked }, layerPlace(node.layer))}
        >
          <Icon name={isLocked ? "lock" : "unlock"} />
        </button>
        <button
          type="button"
          class={`icon-button${node.muted ? " on" : ""}`}
          aria-label={`${node.muted ? "Unmute" : "Mute"} ${node.layer}`}
          aria-pressed={node.muted}
          title={node.muted ? "Muted for everybody" : "Mute for everybody"}
          disabled={!mayEdit}
          onClick={() => void session.edit("mute", { layer: node.layer, muted: !node.muted }, layerPlace(node.layer))}
        >
          <Icon name={node.muted ? "mute" : "sound"} />
        </button>
      </div>
      {state.length > 0 && (
        <div class="layer-state" style={{ paddingLeft: `${30 + 14 * depth}px` }}>
          {state.join(" · ")}
        </div>
      )}
      {refusal && <Refusal path={layerPlace(node.layer)} />}
      {node.children.length > 0 && (
        <ul>
          {node.children.map((child) => (
            <Layer key={child.layer} node={child} depth={depth + 1} />
          ))}
        </ul>
      )}
    </li>
  );
}

const layerPlace = (layer: string) => `layer ${layer}`;

/** The refusal of an edit, at the place where it was made. */
export function Refusal({ path }: { path: string }): JSX.Element | null {
  const { session } = usePage();
  const refusal = session.refusals.value.get(path);
  if (!refusal) return null;
  return (
    <div class="refusal" role="alert">
      <Icon name="warning" />
      <span>{refusal.message}</span>
      <button type="button" class="icon-button" aria-label="Dismiss" onClick={() => session.forgetRefusal(path)}>
        <Icon name="close" />
      </button>
    </div>
  );
}

export function PeoplePanel(): JSX.Element {
  const page = usePage();
  const { session } = page;
  const people = session.people.value;
  const you = session.welcome.value?.you;
  return (
    <section class="panel people" aria-label="People">
      <h2>
        People <span class="count">{people.length + 1}</span>
      </h2>
      <ul class="people-list">
        {you && (
          <li class="person">
            <Avatar name={you.user} color="#ffb020" />
            <div class="person-text">
              <span class="person-name">
                {you.user} <span class="weak">you</span>
              </span>
              <span class="weak">{you.role}</span>
            </div>
            {!session.isSignedIn && <NameForm name={you.user} />}
          </li>
        )}
        {people.map((person) => (
          <PersonRow key={person.id} person={person} />
        ))}
      </ul>
    </section>
  );
}

/** On a server without accounts a person is who they say. */
function NameForm({ name }: { name: string }): JSX.Element {
  const { session } = usePage();
  const isOpen = useSignal(false);
  const draft = useSignal(name);
  if (!isOpen.value) {
    return (
      <button
        type="button"
        class="small"
        onClick={() => {
          isOpen.value = true;
        }}
      >
        Change name
      </button>
    );
  }
  return (
    <form
      class="name-form"
      onSubmit={(event) => {
        event.preventDefault();
        isOpen.value = false;
        session.rename(draft.value.trim());
      }}
    >
      <input
        class="field"
        aria-label="Your name"
        value={draft.value}
        onInput={(event) => {
          draft.value = event.currentTarget.value;
        }}
      />
      <button type="submit" class="small" disabled={draft.value.trim() === ""}>
        Set
      </button>
    </form>
  );
}

function PersonRow({ person }: { person: Person }): JSX.Element {
  const page = usePage();
  const isFollowed = page.followed.value === person.id;
  const [first, ...more] = person.selection;
  return (
    <li class="person" data-person={person.user}>
      <Avatar name={person.user} color={person.color} />
      <div class="person-text">
        <span class="person-name">
          {person.user} <span class="weak">{person.viewer ? "browser" : person.application}</span>
        </span>
        {first === undefined ? (
          <span class="weak">{person.camera ? "looks around" : "has nothing selected"}</span>
        ) : (
          <button
            type="button"
            class="link path"
            title={person.selection.join("\n")}
            onClick={() => page.select(first, false)}
          >
            {lastOf(first)}
            {more.length > 0 && ` and ${more.length} more`}
          </button>
        )}
      </div>
      {person.camera && (
        <button
          type="button"
          class={`small${isFollowed ? " primary" : ""}`}
          aria-pressed={isFollowed}
          onClick={() => page.follow(isFollowed ? undefined : person.id)}
        >
          {isFollowed ? "Following" : "Follow"}
        </button>
      )}
    </li>
  );
}

export function HealthPanel(): JSX.Element {
  const { session } = usePage();
  const welcome = session.welcome.value;
  const state = session.state.value;
  return (
    <section class="panel health" aria-label="Project">
      <h2>Project</h2>
      <dl class="facts">
        <dt>Name</dt>
        <dd>{welcome?.project ?? "…"}</dd>
        <dt>Session</dt>
        <dd>{welcome?.session || "main line"}</dd>
        <dt>Stage</dt>
        <dd>{welcome?.stage ?? "…"}</dd>
        <dt>Revision</dt>
        <dd data-revision={state?.revision ?? 0}>{state?.revision ?? "…"}</dd>
        <dt>Line</dt>
        <dd>
          <LineState />
        </dd>
        <dt>Drawn</dt>
        <dd>{session.items.value.toLocaleString("en")} prims</dd>
      </dl>
    </section>
  );
}
