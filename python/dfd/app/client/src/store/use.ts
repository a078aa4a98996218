import { useEffect, useRef, useState } from "preact/hooks";

import { store, type State } from "./state";

/** Milliseconds between two drawings of numbers that change with every frame of a drag. */
const READABLE = 100;

export function readably(): number {
  return store.get().dragging ? READABLE : 0;
}

/**
 * The state; the component is drawn again when a part that it has read changes, but not within `pause()` milliseconds.
 */
export function useParts(pause: () => number = () => 0): State {
  const keys = useRef(new Set<keyof State>()).current;
  const drawn = useRef(store.get());
  drawn.current = store.get();
  const [, redraw] = useState(0);
  useEffect(() => {
    let timer = 0;
    let last = 0;
    const check = () => {
      const now = store.get();
      if (![...keys].some((key) => now[key] !== drawn.current[key])) return;
      const wait = last + pause() - performance.now();
      clearTimeout(timer);
      if (wait > 0) {
        timer = window.setTimeout(check, wait);
        return;
      }
      last = performance.now();
      redraw((count) => count + 1);
    };
    // The state may have changed since the component was drawn.
    check();
    const stop = store.watch((state) => state, check);
    return () => {
      clearTimeout(timer);
      stop();
    };
  }, []);
  return new Proxy(store.get(), {
    get(state, key: keyof State) {
      keys.add(key);
      return state[key];
    },
  });
}
