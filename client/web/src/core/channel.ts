// Keeps a WebSocket to the gateway, and connects again after longer and longer pauses.

export interface Socket {
  onopen: (() => void) | null;
  onmessage: ((event: { data: unknown }) => void) | null;
  onclose: ((event: { code: number; reason: string }) => void) | null;
  send(data: string): void;
  close(): void;
}

export interface ChannelHandler {
  opened(): void;
  text(text: string): void;
  binary(buffer: ArrayBuffer): void;
  /** `retryMs` is undefined if the gateway does not want this page again. */
  closed(reason: string, retryMs: number | undefined): void;
}

const FIRST_PAUSE_MS = 250;
const LONGEST_PAUSE_MS = 5_000;
/** The gateway closes with these for what another attempt does not change: a bad message, or a token that is wrong. */
const FINAL_CODES = new Set([1008, 4400, 4401]);

/** Returns the pause before attempt number `attempt` (0, 1, ...). `random` is in [0, 1). */
export function pauseMs(attempt: number, random: number): number {
  const longest = Math.min(LONGEST_PAUSE_MS, FIRST_PAUSE_MS * 2 ** attempt);
  return longest * (0.5 + 0.5 * random);
}

/** Each connection is a new socket; nothing of an old one reaches the handler. */
export class Channel {
  private socket: Socket | undefined;
  private isOpen = false;
  private attempt = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly create: () => Socket,
    private readonly handler: ChannelHandler,
    private readonly random: () => number = Math.random,
  ) {}

  connect(): void {
    clearTimeout(this.timer);
    const socket = this.create();
    this.socket = socket;
    socket.onopen = () => {
      if (socket !== this.socket) return;
      this.isOpen = true;
      this.handler.opened();
    };
    socket.onmessage = ({ data }) => {
      if (socket !== this.socket) return;
      this.attempt = 0;
      if (typeof data === "string") this.handler.text(data);
      else if (data instanceof ArrayBuffer) this.handler.binary(data);
    };
    socket.onclose = ({ code, reason }) => {
      if (socket === this.socket) this.lost(code, reason);
    };
  }

  /** Returns false if there is no connection. */
  send(text: string): boolean {
    if (!this.isOpen || !this.socket) return false;
    this.socket.send(text);
    return true;
  }

  close(): void {
    clearTimeout(this.timer);
    const socket = this.socket;
    this.socket = undefined;
    this.isOpen = false;
    socket?.close();
  }

  private lost(code: number, reason: string): void {
    this.socket = undefined;
    this.isOpen = false;
    if (FINAL_CODES.has(code)) {
      this.handler.closed(reason || "the gateway refused this page", undefined);
      return;
    }
    const pause = pauseMs(this.attempt++, this.random());
    this.timer = setTimeout(() => this.connect(), pause);
    this.handler.closed(reason || "the connection to the gateway was lost", pause);
  }
}
