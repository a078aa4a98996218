/** An immutable state that is replaced as a whole, and its listeners. */
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
    /** Replace some keys; listeners of changed keys are called at once. */
    set(change: Partial<State>): void {
      state = { ...state, ...change };
      // Iterate over a copy, because a listener may remove itself or another one.
      for (const watcher of [...watchers]) if (watchers.has(watcher)) watcher();
    },
    /** Call `listener` when the result of `select` changes (arrays by their elements); return a stop function. */
    watch,
    /** Call `listener` when one key changes. */
    on<Key extends keyof State>(key: Key, listener: (part: State[Key], before: State[Key]) => void): () => void {
      return watch((now) => now[key], listener);
    },
  };
}

/** Return whether two values, or the elements of two arrays, are equal. */
export function same(one: unknown, other: unknown): boolean {
  if (!Array.isArray(one) || !Array.isArray(other)) return Object.is(one, other);
  return one.length === other.length && one.every((part, i) => Object.is(part, other[i]));
}
