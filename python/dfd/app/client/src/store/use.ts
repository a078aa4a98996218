import { useLayoutEffect, useReducer, useRef } from "preact/hooks";

import { store, type State } from "./state";

/** Milliseconds between updates during a drag, so that users can read the numbers. */
const READABLE = 100;

/** Return the state. The component is drawn again when a value that it has read changes. */
export function useParts(): State {
  const keys = useRef(new Set<keyof State>()).current;
  const [, redraw] = useReducer((count: number) => count + 1, 0);
  useLayoutEffect(() => {
    let timer = 0;
    const update = () => {
      timer = 0;
      redraw(undefined);
    };
    const stop = store.watch(
      (state) => [...keys].map((key) => state[key]),
      () => {
        if (store.get().dragging) timer ||= window.setTimeout(update, READABLE);
        else update();
      },
    );
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
