import { useEffect, useRef, useState } from "preact/hooks";

import { store, type State } from "./state";
import { same } from "./store";

/**
 * What `select` takes from the state; the component is drawn again when it becomes another value, or array of values,
 * but not within `pause` milliseconds after it was drawn.
 */
export function useStore<Part>(select: (state: State) => Part, pause: () => number = () => 0): Part {
  const part = select(store.get());
  const latest = useRef({ select, pause, part });
  latest.current = { select, pause, part };
  const [, redraw] = useState(0);
  useEffect(() => {
    let timer = 0;
    let drawn = 0;
    const look = () => {
      if (same(latest.current.select(store.get()), latest.current.part)) return;
      const wait = drawn + latest.current.pause() - performance.now();
      if (wait > 0) {
        timer ||= window.setTimeout(() => {
          timer = 0;
          look();
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
    look();
    const stop = store.watch((state) => state, look);
    return () => {
      clearTimeout(timer);
      stop();
    };
  }, []);
  return part;
}
