// Asks again and again for what the gateway does not announce.

/**
 * Calls `load` at once, and again `pauseMs` after it has ended. Leaves it out while it is not wanted. Returns a function that
 * stops it.
 */
export function repeat(load: () => Promise<void>, pauseMs: number, isWanted: () => boolean): () => void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  let isStopped = false;
  const next = async () => {
    if (isWanted()) await load();
    if (!isStopped) timer = setTimeout(() => void next(), pauseMs);
  };
  void next();
  return () => {
    isStopped = true;
    clearTimeout(timer);
  };
}
