// Sends requests and gives each its answer, or an error after a while.
import type { Json, ReplyMessage } from "./protocol";

/** An answer that is no value, or that no answer came. */
export class RequestError extends Error {
  constructor(
    readonly code: string,
    message: string,
  ) {
    super(message);
  }
}

interface Waiting {
  resolve: (value: Json) => void;
  reject: (error: RequestError) => void;
  timer: ReturnType<typeof setTimeout>;
}

export const REQUEST_TIMEOUT_MS = 15_000;

export class Requests {
  private readonly waiting = new Map<number, Waiting>();
  private next = 1;

  /** `send` returns false while there is no connection. */
  constructor(
    private readonly send: (text: string) => boolean,
    private readonly timeoutMs = REQUEST_TIMEOUT_MS,
  ) {}

  ask(
    type: string,
    content: { [key: string]: Json | undefined } = {},
    timeoutMs: number = this.timeoutMs,
  ): Promise<Json> {
    return new Promise((resolve, reject) => {
      const id = this.next++;
      if (!this.send(JSON.stringify({ ...content, type, id }))) {
        reject(new RequestError("Disconnected", "the gateway is not connected; try again when it is"));
        return;
      }
      const timer = setTimeout(() => {
        this.waiting.delete(id);
        reject(new RequestError("Timeout", `no answer to "${type}" within ${timeoutMs / 1000} s`));
      }, timeoutMs);
      this.waiting.set(id, { resolve, reject, timer });
    });
  }

  /** Ignores answers that nobody waits for any more. */
  answer(reply: ReplyMessage): void {
    const waiting = this.waiting.get(reply.id);
    if (!waiting) return;
    this.waiting.delete(reply.id);
    clearTimeout(waiting.timer);
    if (reply.error) waiting.reject(new RequestError(reply.error.code, reply.error.message));
    else waiting.resolve(reply.value ?? null);
  }

  /** Ends all requests: their answers would come over a connection that is lost. */
  failAll(message: string): void {
    for (const { reject, timer } of this.waiting.values()) {
      clearTimeout(timer);
      reject(new RequestError("Disconnected", message));
    }
    this.waiting.clear();
  }
}
