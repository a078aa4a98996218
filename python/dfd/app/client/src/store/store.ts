/** A value that is replaced and never changed, and those who want to hear of it. */
export interface Store<State extends object> {
  get(): State;
  /** Replace some of its parts; those who selected a part that is now another one hear of it at once. */
  set(change: Partial<State>): void;
  /** Call `listener` whenever what `select` takes from the state becomes another value; returns how to stop it. */
  watch<Part>(select: (state: State) => Part, listener: (part: Part, before: Part) => void): () => void;
}

export function createStore<State extends object>(initial: State): Store<State> {
  let state = initial;
  const watchers = new Set<() => void>();
  return {
    get: () => state,
    set(change) {
      state = { ...state, ...change };
      // A copy: a watcher may stop another one, or itself.
      for (const watcher of [...watchers]) if (watchers.has(watcher)) watcher();
    },
    watch(select, listener) {
      let part = select(state);
      const watcher = () => {
        const before = part;
        const now = select(state);
        if (Object.is(now, before)) return;
        part = now;
        listener(now, before);
      };
      watchers.add(watcher);
      return () => watchers.delete(watcher);
    },
  };
}
