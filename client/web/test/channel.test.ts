// Tests the channel, requests and blobs with a clock and sockets of the test.
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { Blobs } from "../src/core/blobs";
import { Channel, pauseMs, type Socket } from "../src/core/channel";
import { Requests } from "../src/core/requests";

beforeEach(() => void vi.useFakeTimers());
afterEach(() => void vi.useRealTimers());

class FakeSocket implements Socket {
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: ((event: { code: number; reason: string }) => void) | null = null;
  readonly sent: string[] = [];
  isClosed = false;
  send(data: string): void {
    this.sent.push(data);
  }
  close(): void {
    this.isClosed = true;
  }
}

function connected() {
  const sockets: FakeSocket[] = [];
  const heard: string[] = [];
  const channel = new Channel(
    () => {
      const socket = new FakeSocket();
      sockets.push(socket);
      return socket;
    },
    {
      opened: () => heard.push("opened"),
      text: (text) => heard.push(text),
      binary: (buffer) => heard.push(`${buffer.byteLength} bytes`),
      closed: (reason, retryMs) => heard.push(`${reason}, ${retryMs}`),
    },
    () => 0.5,
  );
  channel.connect();
  return { channel, sockets, heard };
}

test("a lost connection is made again after longer and longer pauses", () => {
  const { sockets, heard } = connected();
  for (const pause of [187.5, 375, 750]) {
    sockets.at(-1)?.onclose?.({ code: 1006, reason: "" });
    expect(heard.at(-1)).toBe(`the connection to the gateway was lost, ${pause}`);
    vi.advanceTimersByTime(pause - 1);
    const before = sockets.length;
    vi.advanceTimersByTime(1);
    expect(sockets.length).toBe(before + 1);
  }
  sockets.at(-1)?.onopen?.();
  sockets.at(-1)?.onmessage?.({ data: "hello" });
  sockets.at(-1)?.onclose?.({ code: 1006, reason: "restart" });
  expect(heard.slice(-3)).toEqual(["opened", "hello", "restart, 187.5"]);
  expect(pauseMs(20, 0.999)).toBeLessThanOrEqual(5000);
});

test("what arrives late on an old socket is ignored, and a refusal is final", () => {
  const { channel, sockets, heard } = connected();
  sockets[0]?.onopen?.();
  expect(channel.send("a")).toBe(true);
  sockets[0]?.onclose?.({ code: 1006, reason: "" });
  expect(channel.send("b")).toBe(false);
  vi.advanceTimersByTime(5000);
  sockets[0]?.onmessage?.({ data: "late" });
  expect(heard).not.toContain("late");
  sockets[1]?.onclose?.({ code: 1008, reason: "the token is wrong" });
  expect(heard.at(-1)).toBe("the token is wrong, undefined");
  vi.advanceTimersByTime(60_000);
  expect(sockets.length).toBe(2);
});

test("a request gets its answer, its error, or a time-out", async () => {
  const sent: string[] = [];
  const requests = new Requests((text) => sent.push(text) > 0, 1000);
  const [first, second, third] = [requests.ask("children", { path: "/" }), requests.ask("set"), requests.ask("log")];
  expect(JSON.parse(sent[0] as string)).toEqual({ type: "children", path: "/", id: 1 });
  requests.answer({ type: "reply", id: 2, error: { code: "Locked", message: "root.usda is locked by ada" } });
  requests.answer({ type: "reply", id: 1, value: 5 });
  requests.answer({ type: "reply", id: 99, value: 5 });
  await expect(first).resolves.toBe(5);
  await expect(second).rejects.toMatchObject({ code: "Locked", message: "root.usda is locked by ada" });
  vi.advanceTimersByTime(1000);
  await expect(third).rejects.toMatchObject({ code: "Timeout" });
  const long = requests.ask("mergeSession", {}, 5000);
  vi.advanceTimersByTime(4999);
  requests.answer({ type: "reply", id: 4, value: 6 });
  await expect(long).resolves.toBe(6);
});

test("requests end when the connection does", async () => {
  const requests = new Requests(() => true);
  const asked = requests.ask("log");
  requests.failAll("the gateway was lost");
  await expect(asked).rejects.toMatchObject({ code: "Disconnected" });
  await expect(new Requests(() => false).ask("log")).rejects.toMatchObject({ code: "Disconnected" });
});

const answer = (ok: boolean) =>
  Promise.resolve({ ok, status: ok ? 200 : 404, arrayBuffer: async () => new ArrayBuffer(4) });

test("a blob is fetched once, a few at a time", async () => {
  let running = 0;
  let most = 0;
  const arrived: string[] = [];
  const fetched: string[] = [];
  const blobs = new Blobs(
    async (hash) => {
      fetched.push(hash);
      most = Math.max(most, ++running);
      await new Promise((resolve) => setTimeout(resolve, 10));
      running--;
      return answer(true);
    },
    (buffer) => buffer.byteLength,
    (hash) => arrived.push(hash),
  );
  for (let index = 0; index < 20; index++) for (const _ of [1, 2]) blobs.want(`h${index}`);
  await vi.advanceTimersByTimeAsync(200);
  expect([fetched.length, arrived.length, most]).toEqual([20, 20, 8]);
  expect(blobs.get("h3")).toBe(4);
  blobs.keepOnly(new Set(["h4"]));
  expect([blobs.get("h3"), blobs.get("h4")]).toEqual([undefined, 4]);
});

test("a blob that is not there is asked for again; one that is damaged is not", async () => {
  let asked = 0;
  const missing = new Blobs(
    () => answer(++asked > 2),
    () => 1,
    () => undefined,
    10,
  );
  missing.want("a");
  await vi.advanceTimersByTimeAsync(100);
  expect([asked, missing.get("a")]).toEqual([3, 1]);

  let fetched = 0;
  const damaged = new Blobs(
    () => {
      fetched++;
      return answer(true);
    },
    (): number => {
      throw new Error("an index names point 3 of 3");
    },
    () => undefined,
  );
  damaged.want("b");
  await vi.advanceTimersByTimeAsync(10_000);
  damaged.want("b");
  await vi.advanceTimersByTimeAsync(10_000);
  expect([fetched, damaged.problem("b")]).toEqual([1, "blob b cannot be used: an index names point 3 of 3"]);
});
