import { useEffect, useRef, useState } from "preact/hooks";

import type { Store } from "./store";

const AT_ONCE = () => 0;

/**
 * What `select` takes from the state; the component is drawn again when it becomes another value, but not
 * within `pause` milliseconds after it was drawn.
 */
export function useStore<State extends object, Part>(
  store: Store<State>,
  select: (state: State) => Part,
  pause: () => number = AT_ONCE,
): Part {
  const part = select(store.get());
  const latest = useRef({ select, part });
  latest.current = { select, part };
  const [, redraw] = useState(0);
  useEffect(() => {
    let timer = 0;
    let drawn = 0;
    const look = () => {
      if (Object.is(latest.current.select(store.get()), latest.current.part)) return;
      const wait = drawn + pause() - performance.now();
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
  }, [store]);
  return part;
}
