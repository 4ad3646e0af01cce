// For administrators: users, what a rule says about somebody, the audit log, and the numbers of the server.
import { useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect } from "preact/hooks";
import { ago } from "../core/format";
import type { Json } from "../core/protocol";
import { RequestError } from "../core/requests";
import { textOf } from "../state/session";
import { usePage } from "./context";

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

/** Asks what a user may do at a place, and why. */
function Explain(): JSX.Element | null {
  const { session } = usePage();
  const user = useSignal("");
  const answer = useSignal<{ allowed?: boolean; reason?: string } | undefined>(undefined);
  const problem = useSignal("");
  const ask = async () => {
    try {
      const path = session.selection.value.at(-1) ?? "/";
      const layer = session.layers.value[0]?.layer ?? "";
      answer.value = (await session.ask("explain", { user: user.value, layer, path })) as {
        allowed?: boolean;
        reason?: string;
      };
      problem.value = "";
    } catch (error) {
      answer.value = undefined;
      problem.value = textOf(error);
    }
  };
  return (
    <section class="group" aria-label="Explain">
      <h3>May somebody edit the selected prim?</h3>
      <form
        class="checkpoint-form"
        onSubmit={(event) => {
          event.preventDefault();
          void ask();
        }}
      >
        <input
          class="field"
          placeholder="User"
          aria-label="User"
          value={user.value}
          onInput={(event) => {
            user.value = event.currentTarget.value;
          }}
        />
        <button type="submit" class="small" disabled={user.value === ""}>
          Explain
        </button>
      </form>
      {answer.value && (
        <p>
          <strong>{answer.value.allowed ? "Yes." : "No."}</strong> {answer.value.reason}
        </p>
      )}
      {problem.value && <p class="empty bad">{problem.value}</p>}
    </section>
  );
}
