// Loads again what a panel shows, at most once in a while, also when changes never stop.
import { useEffect, useRef } from "preact/hooks";

/**
 * Calls `load` when one of `inputs` has changed, but not within `pauseMs` of the call before; at once if `isUrgent`. A change
 * does not put a waiting call off.
 */
export function useRefresh(load: () => void, pauseMs: number, inputs: unknown[], isUrgent = false): void {
  const last = useRef(Number.NEGATIVE_INFINITY);
  const newest = useRef(load);
  newest.current = load;
  useEffect(() => {
    const wait = isUrgent ? 0 : Math.max(0, last.current + pauseMs - performance.now());
    const timer = setTimeout(() => {
      last.current = performance.now();
      newest.current();
    }, wait);
    return () => clearTimeout(timer);
  }, inputs);
}
