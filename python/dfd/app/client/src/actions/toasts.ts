/** Short messages that disappear after some seconds. */

import { store, type State } from "../store/state";

const SECONDS = { note: 5, problem: 10 } as const;
const MOST = 4;
let next = 1;

/** Show a note, with a button if `action` is given, for example to undo. */
export function note(text: string, action?: State["toasts"][number]["action"]): void {
  show(text, "note", action);
}

export function problem(text: string): void {
  show(text, "problem");
}

export function dismiss(key: number): void {
  store.set({ toasts: store.get().toasts.filter((toast) => toast.key !== key) });
}

function show(text: string, kind: State["toasts"][number]["kind"], action?: State["toasts"][number]["action"]): void {
  const others = store.get().toasts.filter((toast) => toast.text !== text);
  const toast = { key: next++, text, kind, action };
  store.set({ toasts: [...others, toast].slice(-MOST) });
  setTimeout(() => dismiss(toast.key), 1000 * SECONDS[kind]);
}
