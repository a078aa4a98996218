/** The keyboard shortcuts of the page, in the order of the help. */

import { ready, store, type State } from "../store/state";
import { send } from "./connection";
import * as edit from "./edit";
import { chooseFiles } from "./files";
import { leave, play, storePose } from "./timeline";

type Group = "Handle" | "View" | "Edit" | "Tools" | "Timeline";

/** Keys, spelled as in the help, and the action `run`. With `everywhere`, the keys also work on the start page. */
export type Shortcut = readonly [keys: string, group: Group, label: string, run: () => unknown, everywhere?: true];

export const LOOKS = ["texture", "clay", "features", "heat"] as const;
const set = (change: Partial<State>) => () => store.set(change);
const look = (what: NonNullable<State["framed"]>["what"]) => () => store.set({ framed: { what } });

/** Close the help if it is open. Otherwise, leave the tool or mode in use; if there is none, clear the selection. */
function escape(): void {
  const { help, tool, painted, moment, isolated, suggestions } = store.get();
  if (help) store.set({ help: false });
  else if (tool !== "hold" || painted) store.set({ tool: "hold", painted: null });
  else if (moment) leave();
  else if (suggestions.length > 0) store.set({ suggestions: [] });
  else if (isolated) store.set({ isolated: false });
  else edit.select(null);
}

type Switch =
  | "orthographic"
  | "comparing"
  | "snap"
  | "wireframe"
  | "xray"
  | "isolated"
  | "more"
  | "inspector"
  | "help"
  | "timeline"
  | "local";

export function toggle(name: Switch): void {
  store.set({ [name]: !store.get()[name] });
}

function nextLook(): void {
  const { look: now } = store.get();
  store.set({ look: LOOKS[(LOOKS.indexOf(now) + 1) % LOOKS.length] });
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

/** Add a handle at the first suggestion without a handle, for users without a pointer. */
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
  ["D", "Handle", "Bend", set({ gizmo: "bend", tool: "hold" })],
  ["L", "Handle", "Local or world axes", () => toggle("local")],
  ["S", "Handle", "Snap", () => toggle("snap")],
  ["G", "Handle", "Type a motion, such as G X 0.2 Enter", edit.startTyping],
  ["]", "Handle", "Larger part", () => edit.resize(1)],
  ["[", "Handle", "Smaller part", () => edit.resize(-1)],
  ["N", "Handle", "Next handle", () => cycle(1)],
  ["Shift N", "Handle", "Previous handle", () => cycle(-1)],
  ["0", "Handle", "Return to rest", withSelected((handle) => send({ type: "reset", handle }))],
  ["Delete", "Handle", "Remove", withSelected((handle) => send({ type: "remove", handle }))],
  ["Esc", "Handle", "Cancel, or deselect", escape, true],
  ["H", "Tools", "Add handles", set({ tool: "hold" })],
  ["X", "Tools", "Fix points", set({ tool: "fix" })],
  ["B", "Tools", "Brush", set({ tool: "paint" })],
  ["M", "Tools", "Box", set({ tool: "box" })],
  ["P", "Tools", "Move the pivot", set({ tool: "pivot" })],
  ["A", "Tools", "Suggest handles", edit.suggest],
  ["Shift A", "Tools", "Add the next suggested handle", holdNext],
  ["C", "View", "Compare with the original", () => ready(store.get()) && toggle("comparing")],
  ["Z", "View", "Wireframe", () => toggle("wireframe")],
  ["V", "View", "X-ray", () => toggle("xray")],
  ["/", "View", "Show only the handle's part", () => toggle("isolated")],
  ["F", "View", "Frame the handle's part", look("selection")],
  ["Shift F", "View", "Frame the shape", look("shape")],
  ["1", "View", "From the front", look("front")],
  ["3", "View", "From the right", look("right")],
  ["7", "View", "From above", look("top")],
  ["Shift 1", "View", "From behind", look("back")],
  ["Shift 3", "View", "From the left", look("left")],
  ["Shift 7", "View", "From below", look("bottom")],
  ["5", "View", "Orthographic or perspective", () => toggle("orthographic")],
  ["Q", "View", "Next look: texture, clay, features, heat", nextLook],
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

const NAMES: Record<string, string> = {
  " ": "Space",
  escape: "Esc",
  enter: "Enter",
  backspace: "Delete",
  delete: "Delete",
};

/** Return the keys of an event, spelled as in `SHORTCUTS`. */
function keysOf({ key, code, ctrlKey, metaKey, shiftKey }: KeyboardEvent): string {
  // Shift and a digit give other characters, which depend on the keyboard layout.
  const name = /^(Numpad|Digit)\d$/.test(code) ? code.slice(-1) : (NAMES[key.toLowerCase()] ?? key.toUpperCase());
  // Some keyboard layouts need Shift for "?" or "/", so Shift is ignored for these keys.
  return `${ctrlKey || metaKey ? "Ctrl " : ""}${shiftKey && !"?/".includes(name) ? "Shift " : ""}${name}`;
}

/** `grabbed` returns the axis (0 to 2) of the gizmo that the pointer holds, or null. */
export function listen(grabbed: () => number | null): void {
  addEventListener("keydown", (event) => {
    const target = event.target as HTMLElement;
    if (target.matches("input:not([type=range], [type=checkbox]), textarea, select")) return;
    const keys = keysOf(event);
    // Space plays the timeline even if a button has the focus. Enter presses the button.
    if (event.key === " " && target.matches("input, [role=menuitem]")) return;
    const found = shortcut(keys);
    if (!edit.typeKey(keys, grabbed())) {
      if (!found || (store.get().page !== "shape" && !found[4])) return;
      found[3]();
    }
    event.preventDefault();
  });
}
