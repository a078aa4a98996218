import { useEffect, useRef, useState } from "preact/hooks";

import { store, type State } from "./state";
import { same } from "./store";

/** Draw the component again when its state has `changed` since, but not within `pause` milliseconds. */
function useRedraw(changed: (now: State, drawn: State) => boolean, pause: () => number): void {
  const latest = useRef({ changed, pause, state: store.get() });
  latest.current = { changed, pause, state: store.get() };
  const [, redraw] = useState(0);
  useEffect(() => {
    let timer = 0;
    let drawn = 0;
    const check = () => {
      const { changed, pause, state } = latest.current;
      if (!changed(store.get(), state)) return;
      const wait = drawn + pause() - performance.now();
      if (wait > 0) {
        timer ||= window.setTimeout(() => {
          timer = 0;
          check();
        }, wait);
        return;
      }
      // Also before a timer's end, where the pause has become shorter.
      clearTimeout(timer);
      timer = 0;
      drawn = performance.now();
      redraw((count) => count + 1);
    };
    // Between drawing and here the state may have moved on.
    check();
    const stop = store.watch((state) => state, check);
    return () => {
      clearTimeout(timer);
      stop();
    };
  }, []);
}

/** What `select` takes from the state; the component is drawn again when it becomes another value, or array of them. */
export function useStore<Part>(select: (state: State) => Part, pause: () => number = () => 0): Part {
  useRedraw((now, drawn) => !same(select(now), select(drawn)), pause);
  return select(store.get());
}

/** The state; the component is drawn again when a part that it has read becomes another. */
export function useParts(): State {
  const keys = useRef(new Set<keyof State>()).current;
  useRedraw(
    (now, drawn) => [...keys].some((key) => now[key] !== drawn[key]),
    () => 0,
  );
  return new Proxy(store.get(), {
    get(state, key: keyof State) {
      keys.add(key);
      return state[key];
    },
  });
}
