// The properties of the selected prim: values to edit, every opinion with its author, metadata, variants, relationships.
import { useSignal, useSignalEffect } from "@preact/signals";
import type { JSX } from "preact";
import { useRef } from "preact/hooks";
import { ago, lastOf, widgetFor } from "../core/format";
import { type Json, namesOf, type Opinion, type PrimProperties, type Property } from "../core/protocol";
import { textOf } from "../state/session";
import { usePage } from "./context";
import { Icon } from "./icons";
import { Refusal } from "./overview";
import { useRefresh } from "./refresh";
import { typeOf, ValueEditor } from "./widgets";

const RELOAD_PAUSE_MS = 100;
/** The server searches the history for the author of an opinion. */
const BLAME_PAUSE_MS = 1500;

export function PropertiesPanel(): JSX.Element {
  const page = usePage();
  const { session } = page;
  const path = session.selection.value.at(-1);
  const loaded = useSignal<PrimProperties | undefined>(undefined);
  const problem = useSignal("");
  const wish = useSignal(0);
  const filter = useSignal("");

  // A change of the stage may be one of a property that is shown.
  useSignalEffect(() => {
    const changed = session.changed.value;
    const shown = session.selection.value.at(-1);
    if (!changed || shown === undefined) return;
    if (
      changed.all ||
      changed.paths.some((one) => one === shown || one.startsWith(`${shown}.`) || shown.startsWith(`${one}/`))
    )
      wish.value = wish.peek() + 1;
  });
  const time = session.state.value?.time ?? null;
  const past = session.state.value?.past ?? null;
  const resets = session.resets.value;
  const sent = useRef(0);
  const shownNumber = useRef(0);
  const load = async () => {
    if (path === undefined) return;
    const number = ++sent.current;
    try {
      const answer = await session.ask("properties", { path, ...(time === null ? {} : { time }) });
      // An answer may be overtaken by a newer one, or belong to a prim that is no longer selected.
      if (number < shownNumber.current || session.selection.value.at(-1) !== path) return;
      shownNumber.current = number;
      loaded.value = answer as unknown as PrimProperties;
      problem.value = "";
    } catch (error) {
      if (session.selection.value.at(-1) === path) problem.value = textOf(error);
    }
  };
  useRefresh(() => void load(), RELOAD_PAUSE_MS, [path, time, past, resets, wish.value], loaded.value?.path !== path);

  if (path === undefined)
    return <p class="empty">Select a prim in the picture or in the tree to see its properties.</p>;
  const prim = loaded.value?.path === path ? loaded.value : undefined;
  if (!prim) return <p class={`empty${problem.value ? " bad" : ""}`}>{problem.value || "Loading …"}</p>;
  const text = filter.value.trim().toLowerCase();
  const shown = prim.properties.filter(({ name }) => name.toLowerCase().includes(text));
  const mayEdit = session.mayEdit && prim.editable !== false;
  const trouble = page.viewport.value?.problemOf(path);
  return (
    <div class="properties">
      <header class="prim-head">
        <div class="prim-title">
          <strong>{lastOf(prim.path)}</strong> <span class="weak">{prim.type || "no type"}</span>
        </div>
        <div class="path weak" title={prim.path}>
          {prim.path}
        </div>
        {trouble && (
          <p class="problem">
            <Icon name="warning" /> {trouble}
          </p>
        )}
        {problem.value && <p class="problem">{problem.value}</p>}
        <Refusal path={prim.path} />
        <PrimActions prim={prim} />
        {prim.documentation && <p class="documentation">{prim.documentation}</p>}
      </header>
      {prim.variants.length > 0 && <Variants prim={prim} />}
      <div class="search">
        <Icon name="search" />
        <input
          type="search"
          placeholder="Filter properties"
          aria-label="Filter properties"
          value={filter.value}
          onInput={(event) => {
            filter.value = event.currentTarget.value;
          }}
        />
      </div>
      <Group name="Authored" properties={shown.filter(({ authored }) => authored)} path={path} mayEdit={mayEdit} />
      <Group name="Fallback" properties={shown.filter(({ authored }) => !authored)} path={path} mayEdit={mayEdit} />
      <Metadata metadata={prim.metadata} />
    </div>
  );
}

function PrimActions({ prim }: { prim: PrimProperties }): JSX.Element {
  const page = usePage();
  const { session } = page;
  const visibility = prim.properties.find(({ name }) => name === "visibility");
  const isActive = !/^false$/i.test(String(prim.metadata.active ?? "true"));
  const isInvisible = visibility?.value === "invisible" || visibility?.valueText === "invisible";
  return (
    <div class="actions">
      {visibility && (
        <button
          type="button"
          class="small"
          disabled={!session.mayEdit}
          aria-pressed={isInvisible}
          onClick={() => void session.edit("visibility", { path: prim.path, visible: isInvisible }, prim.path)}
        >
          <Icon name={isInvisible ? "hidden" : "eye"} /> {isInvisible ? "Show" : "Hide"}
        </button>
      )}
      <button
        type="button"
        class="small"
        disabled={!session.mayEdit || prim.editable === false}
        onClick={() => void session.edit("activate", { path: prim.path, active: !isActive }, prim.path)}
      >
        {isActive ? "Deactivate" : "Activate"}
      </button>
      <button type="button" class="small" onClick={() => page.viewport.value?.frameOn([prim.path])}>
        <Icon name="frame" /> Frame
      </button>
      {prim.type === "Camera" && (
        <button type="button" class="small" onClick={() => page.lookThrough(prim.path)}>
          <Icon name="camera" /> Look through
        </button>
      )}
    </div>
  );
}

function Variants({ prim }: { prim: PrimProperties }): JSX.Element {
  const { session } = usePage();
  return (
    <section class="group" aria-label="Variants">
      <h3>Variants</h3>
      {prim.variants.map(({ set, selection, choices }) => (
        <div class="property" key={set}>
          <label class="property-head">
            <span class="property-name">{set}</span>
            <select
              value={selection}
              disabled={!session.mayEdit}
              onChange={(event) =>
                void session.edit(
                  "variant",
                  { path: prim.path, set, choice: event.currentTarget.value },
                  `${prim.path}{${set}}`,
                )
              }
            >
              {!choices.includes(selection) && <option value={selection}>{selection || "none"}</option>}
              {choices.map((choice) => (
                <option key={choice} value={choice}>
                  {choice}
                </option>
              ))}
            </select>
          </label>
          <Refusal path={`${prim.path}{${set}}`} />
        </div>
      ))}
    </section>
  );
}

function Group(props: { name: string; properties: Property[]; path: string; mayEdit: boolean }): JSX.Element | null {
  const { name, properties, path, mayEdit } = props;
  if (properties.length === 0) return null;
  return (
    <section class="group" aria-label={`${name} properties`}>
      <h3>
        {name} <span class="count">{properties.length}</span>
      </h3>
      {properties.map((property) => (
        <PropertyRow key={property.name} property={property} path={path} mayEdit={mayEdit} />
      ))}
    </section>
  );
}

function PropertyRow(props: { property: Property; path: string; mayEdit: boolean }): JSX.Element {
  const { property, path, mayEdit } = props;
  const isOpen = useSignal(false);
  const place = `${path}.${property.name}`;
  const { widget } = widgetFor(typeOf(property), property.allowed);
  return (
    <div class={`property${property.authored ? "" : " fallback"}`} data-property={property.name}>
      <div class="property-head">
        <button
          type="button"
          class="property-name"
          aria-expanded={isOpen.value}
          title={`${property.name} (${property.type})`}
          onClick={() => {
            isOpen.value = !isOpen.value;
          }}
        >
          <span class={`twist${isOpen.value ? " open" : ""}`}>
            <Icon name="chevron" />
          </span>
          <span class="name-text">{property.name}</span>
        </button>
        <div class="property-value">
          {property.relationship ? (
            <Paths paths={property.targets} />
          ) : property.connections.length > 0 ? (
            <Paths paths={property.connections} />
          ) : mayEdit && widget !== "none" ? (
            <ValueEditor property={property} path={path} place={place} />
          ) : (
            <span class="value-text" title={property.valueText}>
              {property.valueText || "no value"}
            </span>
          )}
          {property.animated && (
            <span class="badge" title={`${property.samples} time samples`}>
              anim
            </span>
          )}
        </div>
      </div>
      <Refusal path={place} />
      {isOpen.value && <Details property={property} path={path} mayEdit={mayEdit} />}
    </div>
  );
}

function Paths({ paths }: { paths: string[] }): JSX.Element {
  const page = usePage();
  if (paths.length === 0) return <span class="weak">no target</span>;
  return (
    <span class="paths">
      {paths.map((path) => (
        <button
          type="button"
          key={path}
          class="link path"
          title={path}
          onClick={() => page.select(path.split(".")[0], false)}
        >
          {lastOf(path)}
        </button>
      ))}
    </span>
  );
}

/** Shows all of one property: every opinion in the layer stack, the strongest first. */
function Details(props: { property: Property; path: string; mayEdit: boolean }): JSX.Element {
  const { property, path } = props;
  const { session } = usePage();
  const layers = namesOf(session.layers.value);
  const mayEdit = props.mayEdit && !property.relationship && !property.animated;
  const blamed = useSignal<Opinion[] | undefined>(undefined);
  const blame = () => {
    session
      .ask("opinions", { path, name: property.name })
      .then((answer) => {
        blamed.value = (answer as unknown as { opinions?: Opinion[] } | null)?.opinions;
      })
      // The opinions are shown without their authors then.
      .catch(() => undefined);
  };
  useRefresh(blame, BLAME_PAUSE_MS, [property, path]);
  const opinions = withAuthors(property.opinions, blamed.value ?? []);
  return (
    <div class="details">
      <div class="weak">
        {property.type}
        {property.animated && ` · ${property.samples} time samples`}
      </div>
      {property.documentation && <p class="documentation">{property.documentation}</p>}
      {opinions.length === 0 && <p class="weak">No layer has an opinion; this is the fallback of the schema.</p>}
      {opinions.length > 0 && (
        <ol class="opinions">
          {opinions.map((opinion, index) => (
            <li key={`${opinion.layer} ${opinion.path}`} class={index === 0 ? "opinion strongest" : "opinion"}>
              <div class="opinion-head">
                <span class="opinion-layer" title={`${opinion.layer} ${opinion.path}`}>
                  {lastOf(opinion.layer)}
                </span>
                <span class="weak">
                  {[opinion.author, ago(opinion.at), opinion.revision ? `#${opinion.revision}` : ""]
                    .filter(Boolean)
                    .join(" · ")}
                </span>
              </div>
              <code>{opinion.valueText}</code>
              {mayEdit && layers.includes(opinion.layer) && (
                <button
                  type="button"
                  class="link"
                  onClick={() =>
                    void session.edit(
                      "set",
                      { path, name: property.name, value: null, layer: opinion.layer },
                      `${path}.${property.name}`,
                    )
                  }
                >
                  Remove this opinion
                </button>
              )}
            </li>
          ))}
        </ol>
      )}
    </div>
  );
}

/** The opinions with the authors of those that are still the same. */
function withAuthors(opinions: Opinion[], blamed: Opinion[]): Opinion[] {
  return opinions.map((opinion) => {
    const { layer, path, valueText } = opinion;
    return blamed.find((one) => one.layer === layer && one.path === path && one.valueText === valueText) ?? opinion;
  });
}

function Metadata({ metadata }: { metadata: { [key: string]: Json } }): JSX.Element | null {
  const entries = Object.entries(metadata);
  if (entries.length === 0) return null;
  return (
    <section class="group" aria-label="Metadata">
      <h3>Metadata</h3>
      <dl class="facts">
        {entries.map(([key, value]) => [
          <dt key={`${key} name`}>{key}</dt>,
          <dd key={key} class="value-text">
            {typeof value === "string" ? value : JSON.stringify(value)}
          </dd>,
        ])}
      </dl>
    </section>
  );
}
