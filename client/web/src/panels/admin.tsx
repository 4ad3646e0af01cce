// For administrators: users, own rights, the audit log, and the numbers of the server.
import { useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect } from "preact/hooks";
import { ago } from "../core/format";
import { type Json, namesOf } from "../core/protocol";
import { RequestError } from "../core/requests";
import { textOf } from "../state/session";
import { usePage } from "./context";

/** More layers are not asked for: each is a request. */
const MOST_LAYERS = 20;

type Entry = { [key: string]: Json };

export function AdminPanel(): JSX.Element {
  return (
    <div class="admin">
      <List type="users" title="Users" columns={["name", "role"]} />
      <Explain />
      <List type="audit" title="Audit log" columns={["at", "user", "action", "detail"]} />
      <List type="metrics" title="Numbers of the server" columns={["name", "value"]} />
    </div>
  );
}

/** A list that the gateway offers. What it does not offer is not shown. */
function List({ type, title, columns }: { type: string; title: string; columns: string[] }): JSX.Element | null {
  const { session } = usePage();
  const items = useSignal<Entry[] | undefined>(undefined);
  const problem = useSignal("");
  const isMissing = useSignal(false);
  const load = async () => {
    try {
      const answer = await session.ask(type, { limit: 100 });
      items.value = (answer as { items?: Entry[] } | null)?.items ?? [];
      problem.value = "";
    } catch (error) {
      isMissing.value = error instanceof RequestError && error.code === "Unsupported";
      problem.value = textOf(error);
    }
  };
  useEffect(() => void load(), []);
  if (isMissing.value) return null;
  return (
    <section class="group" aria-label={title}>
      <h3>
        {title}
        <button type="button" class="small quiet" onClick={() => void load()}>
          Reload
        </button>
      </h3>
      {problem.value && <p class="empty bad">{problem.value}</p>}
      {items.value?.length === 0 && <p class="empty">Nothing yet.</p>}
      {items.value && items.value.length > 0 && (
        <table>
          <thead>
            <tr>
              {columns.map((column) => (
                <th key={column} scope="col">
                  {column}
                </th>
              ))}
            </tr>
          </thead>
          <tbody>
            {items.value.map((item, index) => (
              <tr key={`${index} ${JSON.stringify(item)}`}>
                {columns.map((column) => (
                  <td key={column}>{cell(column, item[column])}</td>
                ))}
              </tr>
            ))}
          </tbody>
        </table>
      )}
    </section>
  );
}

function cell(column: string, value: Json | undefined): string {
  if (value === null || value === undefined) return "";
  if (column === "at" && (typeof value === "string" || typeof value === "number")) return ago(value);
  return typeof value === "string" ? value : JSON.stringify(value);
}

/** Tells in which layers the person of this page may edit the selected prim, and why. */
function Explain(): JSX.Element {
  const { session } = usePage();
  const path = session.selection.value.at(-1) ?? "/";
  const answers = useSignal<{ layer: string; allowed: boolean; reason: string }[]>([]);
  const problem = useSignal("");
  const layers = session.layers.value;
  useEffect(() => {
    let isOld = false;
    const ask = async (layer: string) => {
      const { allowed, reason } = (await session.ask("explain", { layer, path })) as {
        allowed: boolean;
        reason: string;
      };
      return { layer, allowed, reason };
    };
    Promise.all(namesOf(layers).slice(0, MOST_LAYERS).map(ask))
      .then((found) => {
        if (isOld) return;
        answers.value = found;
        problem.value = "";
      })
      .catch((error: unknown) => {
        if (!isOld) problem.value = textOf(error);
      });
    return () => {
      isOld = true;
    };
  }, [path, layers]);
  return (
    <section class="group" aria-label="Your rights">
      <h3>Your rights at {path}</h3>
      {problem.value && <p class="empty bad">{problem.value}</p>}
      <table>
        <tbody>
          {answers.value.map(({ layer, allowed, reason }) => (
            <tr key={layer}>
              <th scope="row">{layer}</th>
              <td>
                {allowed ? "may edit" : "may not edit"}: {reason}
              </td>
            </tr>
          ))}
        </tbody>
      </table>
    </section>
  );
}
