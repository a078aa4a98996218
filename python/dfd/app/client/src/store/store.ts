/** A value that is replaced and never changed, and those who want to hear of it. */
export function createStore<State extends object>(initial: State) {
  let state = initial;
  const watchers = new Set<() => void>();
  function watch<Part>(select: (state: State) => Part, listener: (part: Part, before: Part) => void): () => void {
    let part = select(state);
    const watcher = () => {
      const before = part;
      const now = select(state);
      if (same(now, before)) return;
      part = now;
      listener(now, before);
    };
    watchers.add(watcher);
    return () => watchers.delete(watcher);
  }
  return {
    get: () => state,
    /** Replace some of its parts; those who watch a part that is now another one hear of it at once. */
    set(change: Partial<State>): void {
      state = { ...state, ...change };
      // A copy: a watcher may stop another one, or itself.
      for (const watcher of [...watchers]) if (watchers.has(watcher)) watcher();
    },
    /** Call `listener` whenever `select` takes another value, or array of values, from the state; returns how to stop. */
    watch,
    /** The same of one part of the state. */
    on<Key extends keyof State>(key: Key, listener: (part: State[Key], before: State[Key]) => void): () => void {
      return watch((now) => now[key], listener);
    },
  };
}

/** Whether two values are the same, or arrays of the same values. */
export function same(one: unknown, other: unknown): boolean {
  if (!Array.isArray(one) || !Array.isArray(other)) return Object.is(one, other);
  return one.length === other.length && one.every((part, i) => Object.is(part, other[i]));
}
