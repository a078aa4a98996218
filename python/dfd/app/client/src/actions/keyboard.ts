/** Every key of the page, in one table that the overlay shows too. */

import { ready, store, type State } from "../store/state";
import { send } from "./connection";
import * as edit from "./edit";
import { chooseFiles } from "./files";
import { play, storePose } from "./timeline";

type Group = "Handle" | "View" | "Edit" | "Tools" | "Timeline";

/** Keys as they are shown, what they do, and whether they do it on the start page, too. */
export type Shortcut = readonly [keys: string, group: Group, label: string, run: () => unknown, everywhere?: true];

export const LOOKS = ["texture", "clay", "features", "heat"] as const;
const set = (change: Partial<State>) => () => store.set(change);

/** Switch what is on or off. */
export function toggle(name: "snap" | "wireframe" | "inspector" | "help" | "timeline" | "uniformScale"): void {
  store.set({ [name]: !store.get()[name] });
}

function toggleSpace(): void {
  store.set({ space: store.get().space === "world" ? "local" : "world" });
}

function toggleQuality(): void {
  store.set({ quality: store.get().quality === "auto" ? "full" : "auto" });
}

const withSelected = (run: (handle: number) => void) => () => {
  const { selected } = store.get();
  if (selected !== null) run(selected);
};

function cycle(by: number): void {
  const { edit: known, selected } = store.get();
  const ids = known?.handles.map((handle) => handle.handle) ?? [];
  if (ids.length === 0) return;
  const at = selected === null ? (by > 0 ? -1 : 0) : ids.indexOf(selected);
  edit.select(ids[(at + by + ids.length) % ids.length]);
}

/** Hold the first suggestion that is free: the way to a handle without a pointer. */
function holdNext(): void {
  const { suggestions, edit: known } = store.get();
  const free = suggestions.find(({ vertex }) => !known?.handles.some((handle) => handle.vertex === vertex));
  if (free) edit.hold(free.vertex);
  else if (suggestions.length === 0) edit.suggest();
}

export const SHORTCUTS: readonly Shortcut[] = [
  ["W", "Handle", "Move", set({ gizmo: "translate", tool: "hold" })],
  ["E", "Handle", "Rotate", set({ gizmo: "rotate", tool: "hold" })],
  ["R", "Handle", "Scale", set({ gizmo: "scale", tool: "hold" })],
  ["L", "Handle", "Local or world axes", toggleSpace],
  ["S", "Handle", "Snap", () => toggle("snap")],
  ["]", "Handle", "More reach", withSelected((handle) => edit.wheelReach(handle, 1.08))],
  ["[", "Handle", "Less reach", withSelected((handle) => edit.wheelReach(handle, 1 / 1.08))],
  ["N", "Handle", "Next handle", () => cycle(1)],
  ["Shift N", "Handle", "Previous handle", () => cycle(-1)],
  ["0", "Handle", "Return to rest", withSelected((handle) => send({ type: "reset", handle }))],
  ["Delete", "Handle", "Remove", withSelected((handle) => send({ type: "remove", handle }))],
  ["Esc", "Handle", "Let go of the selection", () => edit.select(null)],
  ["H", "Tools", "Hold points", set({ tool: "hold" })],
  ["X", "Tools", "Fix points", set({ tool: "fix" })],
  ["B", "Tools", "Brush", set({ tool: "paint" })],
  ["P", "Tools", "Move the pivot", set({ tool: "pivot" })],
  ["G", "Tools", "Suggest handles", edit.suggest],
  ["Shift G", "Tools", "Hold the next suggestion", holdNext],
  ["Z", "View", "Wireframe", () => toggle("wireframe")],
  ["Q", "View", "Full quality while moving", toggleQuality],
  ["F", "View", "Frame the shape", () => store.set({ framed: store.get().framed + 1 })],
  ["I", "View", "Inspector", () => toggle("inspector")],
  ["?", "View", "Keys", () => toggle("help"), true],
  ["Ctrl Z", "Edit", "Undo", () => store.get().edit?.can_undo && send({ type: "undo" })],
  ["Ctrl Shift Z", "Edit", "Redo", () => store.get().edit?.can_redo && send({ type: "redo" })],
  ["Ctrl O", "Edit", "Open a file", chooseFiles, true],
  ["T", "Timeline", "Timeline", () => toggle("timeline")],
  ["K", "Timeline", "Store a key pose", storePose],
  ["Space", "Timeline", "Play", play],
];

export function shortcut(keys: string): Shortcut | undefined {
  return SHORTCUTS.find((each) => each[0] === keys);
}

const NAMES: Record<string, string> = { " ": "Space", escape: "Esc", backspace: "Delete", delete: "Delete" };

/** The keys of an event, as the table has them. */
function keysOf({ key, ctrlKey, metaKey, shiftKey }: KeyboardEvent): string {
  const name = NAMES[key.toLowerCase()] ?? key.toUpperCase();
  // Where "?" lies under Shift differs from keyboard to keyboard.
  return `${ctrlKey || metaKey ? "Ctrl " : ""}${shiftKey && name !== "?" ? "Shift " : ""}${name}`;
}

export function listen(): void {
  addEventListener("keydown", (event) => {
    const target = event.target as HTMLElement;
    if (target.matches("input:not([type=range], [type=checkbox]), textarea, select")) return;
    const keys = keysOf(event);
    if (keys === "C" && !event.repeat) {
      if (ready(store.get())) store.set({ comparing: true });
      return;
    }
    if (event.key === " " && target.matches("button, input, [role=menuitem]")) return;
    const { help, page } = store.get();
    if (keys === "Esc" && help) {
      store.set({ help: false });
      return;
    }
    const look = LOOKS.at(Number(keys) - 1);
    const found = shortcut(keys);
    if (page !== "shape" && !found?.[4]) return;
    if (found) found[3]();
    else if (look && Number(keys) >= 1) store.set({ look });
    else return;
    event.preventDefault();
  });
  addEventListener("keyup", (event) => {
    if (event.key.toLowerCase() === "c") store.set({ comparing: false });
  });
  addEventListener("blur", () => store.set({ comparing: false }));
}
