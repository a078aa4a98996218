/** Create a store of an immutable state, which is replaced as a whole. */
export function createStore<State extends object>(initial: State) {
  let state = initial;
  const watchers = new Set<() => void>();
  function watch<Part>(select: (state: State) => Part, listener: (part: Part) => unknown): () => void {
    let part = select(state);
    const watcher = () => {
      const before = part;
      part = select(state);
      if (!same(part, before)) listener(part);
    };
    watchers.add(watcher);
    return () => watchers.delete(watcher);
  }
  return {
    get: () => state,
    /** Replace some values of the state, and call the listeners of the values that changed. */
    set(change: Partial<State>): void {
      state = { ...state, ...change };
      // A listener may remove itself or another listener.
      for (const watcher of [...watchers]) if (watchers.has(watcher)) watcher();
    },
    /** Call `listener` when the result of `select` or an element of this result changes. Return a function to stop. */
    watch,
    /** Call `listener` when one key changes. */
    on<Key extends keyof State>(key: Key, listener: (part: State[Key]) => unknown): () => void {
      return watch((now) => now[key], listener);
    },
  };
}

/** Return whether two values, or the elements of two arrays, are equal. */
function same(one: unknown, other: unknown): boolean {
  if (!Array.isArray(one) || !Array.isArray(other)) return Object.is(one, other);
  return one.length === other.length && one.every((part, i) => Object.is(part, other[i]));
}
