// Holds what the page knows of the project, and speaks with the gateway.
import { batch, signal } from "@preact/signals";
import { decodeBatch } from "../core/batch";
import { Channel, type Socket } from "../core/channel";
import type {
  ChangedMessage,
  Json,
  LayerNode,
  Person,
  RefusedMessage,
  SceneMessage,
  StateMessage,
  Welcome,
} from "../core/protocol";
import { parseMessage } from "../core/protocol";
import { RequestError, Requests } from "../core/requests";
import { SceneStore } from "../core/scene";

export type Line =
  | { state: "connecting" }
  | { state: "open" }
  | { state: "lost"; reason: string; retryMs: number }
  | { state: "refused"; reason: string };

/** The part of the browser that keeps who the person is. */
export interface Memory {
  /** The fields of the first message to the gateway. */
  hello(): { [key: string]: Json };
  setName(name: string): void;
  /** Kept until the tab is closed. */
  setToken(token: string): void;
}

export interface Notice {
  number: number;
  text: string;
}

const PRESENCE_PAUSE_MS = 100;
const MOST_NOTICES = 4;
const MOST_REFUSALS = 50;

export class Session {
  readonly line = signal<Line>({ state: "connecting" });
  readonly welcome = signal<Welcome | undefined>(undefined);
  readonly state = signal<StateMessage | undefined>(undefined);
  readonly people = signal<Person[]>([]);
  readonly layers = signal<LayerNode[]>([]);
  readonly selection = signal<string[]>([]);
  readonly changed = signal<ChangedMessage | undefined>(undefined);
  /** Refusals of own edits by path; the newest of each. They stay until the same place is edited again. */
  readonly refusals = signal<ReadonlyMap<string, RefusedMessage>>(new Map());
  readonly notices = signal<Notice[]>([]);
  /** Counts resets of the scene: what was loaded on demand has to be loaded again. */
  readonly resets = signal(0);
  readonly items = signal(0);
  /** Why the gateway wants a token, or undefined. */
  readonly signIn = signal<string | undefined>(undefined);
  readonly store = new SceneStore();
  readonly requests: Requests;
  /** Called after each message that may change the picture. */
  sceneArrived: (isReset: boolean, isComplete: boolean, isOtherStage: boolean) => void = () => undefined;
  /** The prim that the person of this page drags. What arrives for it is older. */
  draggedPath = "";
  private readonly channel: Channel;
  private readonly pending = new Map<string, { [key: string]: Json }>();
  private presenceTimer: ReturnType<typeof setTimeout> | undefined;
  private shownStage = "";
  private numbers = 0;

  constructor(
    create: () => Socket,
    private readonly memory: Memory,
  ) {
    this.channel = new Channel(create, {
      opened: () => this.opened(),
      text: (text) => this.received(text),
      binary: (buffer) => this.receivedBatch(buffer),
      closed: (reason, retryMs) => this.closed(reason, retryMs),
    });
    this.requests = new Requests((text) => this.channel.send(text));
  }

  connect(): void {
    this.channel.connect();
  }

  /** Connects again with what `hello` says now. */
  reconnect(): void {
    this.channel.close();
    this.line.value = { state: "connecting" };
    this.channel.connect();
  }

  /** Whether the person has given a token; the server knows the name then. */
  get isSignedIn(): boolean {
    return this.memory.hello().token !== undefined;
  }

  rename(name: string): void {
    this.memory.setName(name);
    this.reconnect();
  }

  signInWith(token: string): void {
    this.memory.setToken(token);
    this.signIn.value = undefined;
    this.reconnect();
  }

  ask(type: string, content: { [key: string]: Json | undefined } = {}, timeoutMs?: number): Promise<Json> {
    return this.requests.ask(type, content, timeoutMs);
  }

  /** Sends an edit. A refusal is kept for the place `path`, and returned as a text. */
  async edit(type: string, content: { [key: string]: Json | undefined }, path: string): Promise<string | undefined> {
    this.forgetRefusal(path);
    try {
      await this.ask(type, content);
      return undefined;
    } catch (error) {
      const message = textOf(error);
      this.refused({ type: "refused", path, layer: "", message });
      return message;
    }
  }

  forgetRefusal(path: string): void {
    if (!this.refusals.value.has(path)) return;
    const left = new Map(this.refusals.value);
    left.delete(path);
    this.refusals.value = left;
  }

  select(paths: string[]): void {
    if (paths.join("\n") === this.selection.value.join("\n")) return;
    this.selection.value = paths;
    this.present("select", { paths });
  }

  moveCamera(matrix: number[]): void {
    this.present("camera", { matrix });
  }

  notify(text: string): void {
    const number = ++this.numbers;
    this.notices.value = [...this.notices.value.filter((notice) => notice.text !== text), { number, text }].slice(
      -MOST_NOTICES,
    );
    setTimeout(() => this.dismiss(number), 8000);
  }

  dismiss(number: number): void {
    this.notices.value = this.notices.value.filter((notice) => notice.number !== number);
  }

  get mayEdit(): boolean {
    return this.welcome.value?.you.mayEdit === true && this.state.value?.past == null;
  }

  private opened(): void {
    this.channel.send(JSON.stringify({ ...this.memory.hello(), type: "hello" }));
  }

  private closed(reason: string, retryMs: number | undefined): void {
    this.requests.failAll(reason);
    this.line.value = retryMs === undefined ? { state: "refused", reason } : { state: "lost", reason, retryMs };
  }

  /** Sends presence at most ten times a second, the newest of each type. */
  private present(type: string, content: { [key: string]: Json }): void {
    this.pending.set(type, content);
    if (this.presenceTimer !== undefined) return;
    this.presenceTimer = setTimeout(() => {
      this.presenceTimer = undefined;
      // An answer brings nothing, and a lost one is followed by the next.
      for (const [name, value] of this.pending) this.ask(name, value).catch(() => undefined);
      this.pending.clear();
    }, PRESENCE_PAUSE_MS);
  }

  private received(text: string): void {
    const message = parseMessage(text);
    if (!message) {
      this.notify("the gateway sent a message that this page does not understand; reload the page");
      return;
    }
    try {
      switch (message.type) {
        case "welcome":
          this.welcomed(message);
          break;
        case "scene":
          this.receivedScene(message);
          break;
        case "presence":
          this.people.value = message.people;
          break;
        case "layers":
          this.layers.value = message.stack;
          break;
        case "changed":
          this.changed.value = message;
          break;
        case "state":
          this.state.value = message;
          break;
        case "refused":
          this.refused(message);
          break;
        case "about":
          if (this.welcome.value) this.welcome.value = { ...this.welcome.value, ...message, type: "welcome" };
          break;
        case "signIn":
          this.signIn.value = message.message;
          break;
        case "reply":
          this.requests.answer(message);
          break;
      }
    } catch (error) {
      this.notify(`a message of the gateway cannot be used: ${textOf(error)}`);
    }
  }

  private welcomed(message: Welcome): void {
    batch(() => {
      this.line.value = { state: "open" };
      this.signIn.value = undefined;
      this.welcome.value = message;
      const { connected, revision } = message.server;
      const past = this.state.value?.past ?? null;
      this.state.value = { type: "state", connected, revision, time: message.time, past, message: "" };
    });
    if (this.selection.value.length > 0) this.present("select", { paths: this.selection.value });
  }

  private receivedScene(message: SceneMessage): void {
    this.store.applyScene(message);
    const stage = this.welcome.value?.stage ?? "";
    this.sceneArrived(message.reset === true, message.more !== true, stage !== this.shownStage);
    this.shownStage = stage;
    this.items.value = this.store.items.size;
    if (message.reset) this.resets.value = this.resets.peek() + 1;
  }

  private receivedBatch(buffer: ArrayBuffer): void {
    try {
      const decoded = decodeBatch(buffer);
      this.store.applyBatch(decoded, this.draggedPath === "" ? undefined : this.store.idOf(this.draggedPath));
      this.sceneArrived(false, true, false);
    } catch (error) {
      this.notify(`a frame of the gateway cannot be used: ${textOf(error)}`);
    }
  }

  private refused(message: RefusedMessage): void {
    const all = new Map(this.refusals.value);
    all.delete(message.path);
    all.set(message.path, message);
    for (const oldest of all.keys()) {
      if (all.size <= MOST_REFUSALS) break;
      all.delete(oldest);
    }
    this.refusals.value = all;
    if (message.path === "") this.notify(message.message);
  }
}

export function textOf(error: unknown): string {
  if (error instanceof RequestError || error instanceof Error) return error.message;
  return String(error);
}
