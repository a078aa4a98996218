import { useEffect, useRef, useState } from "preact/hooks";

import { store, type State } from "./state";

/** Milliseconds between updates during a drag, so that users can read the numbers. */
const READABLE = 100;

/** Return the state. The component is drawn again when a value that it has read changes. */
export function useParts(): State {
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
      const wait = last + (now.dragging ? READABLE : 0) - performance.now();
      clearTimeout(timer);
      if (wait > 0) {
        timer = window.setTimeout(check, wait);
        return;
      }
      last = performance.now();
      redraw((count) => count + 1);
    };
    // The state may have changed since the last update.
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
