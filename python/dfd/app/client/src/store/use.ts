import { useEffect, useRef, useState } from "preact/hooks";

import type { Store } from "./store";

/** What `select` takes from the state; the component is drawn again when it becomes another value. */
export function useStore<State extends object, Part>(store: Store<State>, select: (state: State) => Part): Part {
  const part = select(store.get());
  const latest = useRef({ select, part });
  latest.current = { select, part };
  const [, redraw] = useState(0);
  useEffect(() => {
    const look = () => {
      if (!Object.is(latest.current.select(store.get()), latest.current.part)) redraw((count) => count + 1);
    };
    // Between drawing and here the state may have moved on.
    look();
    return store.watch((state) => state, look);
  }, [store]);
  return part;
}
