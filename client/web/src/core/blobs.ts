// Fetches blobs by their hash: each once, a few at a time, and again after a failure that may pass.

export interface BlobAnswer {
  ok: boolean;
  status: number;
  arrayBuffer(): Promise<ArrayBuffer>;
}

const AT_ONCE = 8;
const ATTEMPTS = 4;
const PAUSE_MS = 400;

/** Decoded blobs by hash. A blob that nobody uses any more is dropped by `keepOnly`. */
export class Blobs<T> {
  private readonly ready = new Map<string, T>();
  private readonly failed = new Map<string, string>();
  private readonly queue: string[] = [];
  private readonly wanted = new Set<string>();
  private running = 0;

  /** `arrived` is called for each hash that became ready or failed. */
  constructor(
    private readonly fetchBlob: (hash: string) => Promise<BlobAnswer>,
    private readonly decode: (buffer: ArrayBuffer) => T,
    private readonly arrived: (hash: string) => void,
    private readonly pauseMs = PAUSE_MS,
  ) {}

  get(hash: string): T | undefined {
    return this.ready.get(hash);
  }

  /** The reason why this blob cannot be shown, or undefined. */
  problem(hash: string): string | undefined {
    return this.failed.get(hash);
  }

  get pending(): number {
    return this.wanted.size;
  }

  want(hash: string): void {
    if (this.ready.has(hash) || this.failed.has(hash) || this.wanted.has(hash)) return;
    this.wanted.add(hash);
    this.queue.push(hash);
    this.pump();
  }

  /** Lets blobs that failed be asked for again: the gateway may have them now. */
  forgetFailures(): void {
    this.failed.clear();
  }

  keepOnly(used: ReadonlySet<string>): void {
    for (const hash of this.ready.keys()) if (!used.has(hash)) this.ready.delete(hash);
  }

  private pump(): void {
    while (this.running < AT_ONCE) {
      const hash = this.queue.shift();
      if (hash === undefined) return;
      this.running++;
      void this.load(hash).finally(() => {
        this.running--;
        this.wanted.delete(hash);
        this.arrived(hash);
        this.pump();
      });
    }
  }

  private async load(hash: string): Promise<void> {
    let problem = "";
    for (let attempt = 0; attempt < ATTEMPTS; attempt++) {
      if (attempt > 0) await new Promise((resolve) => setTimeout(resolve, this.pauseMs * 2 ** (attempt - 1)));
      let buffer: ArrayBuffer;
      try {
        const answer = await this.fetchBlob(hash);
        if (!answer.ok) {
          problem = `the gateway answered ${answer.status} for blob ${hash.slice(0, 12)}`;
          continue;
        }
        buffer = await answer.arrayBuffer();
      } catch (error) {
        problem = `blob ${hash.slice(0, 12)} cannot be fetched: ${error instanceof Error ? error.message : String(error)}`;
        continue;
      }
      try {
        this.ready.set(hash, this.decode(buffer));
        return;
      } catch (error) {
        // The content has this hash: asking again gives the same bytes.
        problem = `blob ${hash.slice(0, 12)} cannot be used: ${error instanceof Error ? error.message : String(error)}`;
        break;
      }
    }
    this.failed.set(hash, problem);
  }
}
