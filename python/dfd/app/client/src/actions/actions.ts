/** What the user can do, by name. Buttons, menus, the help and the keys all call these actions. */

import { ready, store, type State } from "../store/state";
import { send } from "./connection";
import * as edit from "./edit";
import { chooseFiles } from "./files";
import { dropMark } from "./marks";
import { take } from "./propose";
import { leave, play, storePose } from "./timeline";

type Group = "Handle" | "View" | "Edit" | "Tools" | "Timeline";

export interface Action {
  /** Keys, spelled as in the help. */
  readonly keys: string;
  /** Other keys for the same action. */
  readonly also?: string;
  readonly group: Group;
  readonly label: string;
  readonly run: () => unknown;
  /** Whether the keys also work on the start page. */
  readonly everywhere?: true;
}

export const LOOKS = ["texture", "clay", "features", "heat"] as const;
const set = (change: Partial<State>) => () => store.set(change);
const look = (what: NonNullable<State["framed"]>["what"]) => () => store.set({ framed: { what } });

/** Leave the tool or mode in use; if there is none, clear the selection. */
function escape(): void {
  if (dropMark(true)) return;
  const { tool, painted, moment, isolated, suggestions } = store.get();
  if (tool !== "hold" || painted) store.set({ tool: "hold", painted: null });
  else if (moment) leave();
  else if (suggestions.length > 0) store.set({ suggestions: [] });
  else if (isolated) store.set({ isolated: false });
  else edit.select(null);
}

/** Keys of the state that are on or off. */
type Switch = { [Key in keyof State]: State[Key] extends boolean ? Key : never }[keyof State];

export function toggle(name: Switch): void {
  store.set({ [name]: !store.get()[name] });
}

function nextLook(): void {
  const { look: now } = store.get();
  store.set({ look: LOOKS[(LOOKS.indexOf(now) + 1) % LOOKS.length] });
}

function sendSelected(type: "reset" | "remove"): void {
  const { selected: handle } = store.get();
  if (handle !== null) send({ type, handle });
}

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

export const ACTIONS = {
  translate: { keys: "W", group: "Handle", label: "Move", run: set({ gizmo: "translate", tool: "hold" }) },
  rotate: { keys: "E", group: "Handle", label: "Rotate", run: set({ gizmo: "rotate", tool: "hold" }) },
  scale: { keys: "R", group: "Handle", label: "Scale", run: set({ gizmo: "scale", tool: "hold" }) },
  bend: { keys: "D", group: "Handle", label: "Bend", run: set({ gizmo: "bend", tool: "hold" }) },
  local: { keys: "L", group: "Handle", label: "Local or world axes", run: () => toggle("local") },
  snap: { keys: "S", group: "Handle", label: "Snap", run: () => toggle("snap") },
  type: { keys: "G", group: "Handle", label: "Type a motion, such as G X 0.2 Enter", run: edit.startTyping },
  larger: { keys: "]", group: "Handle", label: "Larger part", run: () => edit.resize(1) },
  smaller: { keys: "[", group: "Handle", label: "Smaller part", run: () => edit.resize(-1) },
  first: { keys: "Alt 1", group: "Handle", label: "Take the first proposal", run: () => take(0) },
  second: { keys: "Alt 2", group: "Handle", label: "Take the second proposal", run: () => take(1) },
  third: { keys: "Alt 3", group: "Handle", label: "Take the third proposal", run: () => take(2) },
  next: { keys: "N", group: "Handle", label: "Next handle", run: () => cycle(1) },
  previous: { keys: "Shift N", group: "Handle", label: "Previous handle", run: () => cycle(-1) },
  reset: { keys: "0", group: "Handle", label: "Return to rest", run: () => sendSelected("reset") },
  remove: { keys: "Delete", group: "Handle", label: "Remove", run: () => sendSelected("remove") },
  escape: { keys: "Esc", group: "Handle", label: "Cancel, or deselect", run: escape },
  hold: { keys: "H", group: "Tools", label: "Add handles", run: set({ tool: "hold" }) },
  fix: { keys: "X", group: "Tools", label: "Fix points", run: set({ tool: "fix" }) },
  paint: { keys: "B", group: "Tools", label: "Brush", run: set({ tool: "paint" }) },
  box: { keys: "M", group: "Tools", label: "Box", run: set({ tool: "box" }) },
  pivot: { keys: "P", group: "Tools", label: "Move the pivot", run: set({ tool: "pivot" }) },
  marks: { keys: "J", group: "Tools", label: "Marks that must arrive", run: set({ tool: "marks" }) },
  suggest: { keys: "A", group: "Tools", label: "Suggest handles", run: edit.suggest },
  addSuggested: { keys: "Shift A", group: "Tools", label: "Add the next suggested handle", run: holdNext },
  compare: {
    keys: "C",
    group: "View",
    label: "Compare with the original",
    run: () => ready(store.get()) && toggle("comparing"),
  },
  wire: { keys: "Z", group: "View", label: "Wireframe", run: () => toggle("wireframe") },
  xray: { keys: "V", group: "View", label: "X-ray", run: () => toggle("xray") },
  isolate: { keys: "/", group: "View", label: "Show only the handle's part", run: () => toggle("isolated") },
  weights: { keys: "Y", group: "View", label: "Color what follows", run: () => toggle("weights") },
  frame: { keys: "F", group: "View", label: "Frame the handle's part", run: look("selection") },
  frameShape: { keys: "Shift F", group: "View", label: "Frame the shape", run: look("shape") },
  front: { keys: "1", group: "View", label: "From the front", run: look("front") },
  right: { keys: "3", group: "View", label: "From the right", run: look("right") },
  top: { keys: "7", group: "View", label: "From above", run: look("top") },
  back: { keys: "Shift 1", group: "View", label: "From behind", run: look("back") },
  left: { keys: "Shift 3", group: "View", label: "From the left", run: look("left") },
  bottom: { keys: "Shift 7", group: "View", label: "From below", run: look("bottom") },
  orthographic: { keys: "5", group: "View", label: "Orthographic or perspective", run: () => toggle("orthographic") },
  look: { keys: "Q", group: "View", label: "Next look: texture, clay, features, heat", run: nextLook },
  inspector: { keys: "I", group: "View", label: "Inspector", run: () => toggle("inspector") },
  help: { keys: "?", group: "View", label: "Keys", run: () => toggle("help"), everywhere: true },
  undo: {
    keys: "Ctrl Z",
    group: "Edit",
    label: "Undo",
    run: () => send({ type: "go", by: -1 }),
  },
  redo: {
    keys: "Ctrl Shift Z",
    also: "Ctrl Y",
    group: "Edit",
    label: "Redo",
    run: () => send({ type: "go", by: 1 }),
  },
  open: { keys: "Ctrl O", group: "Edit", label: "Open a file", run: chooseFiles, everywhere: true },
  timeline: { keys: "T", group: "Timeline", label: "Timeline", run: () => toggle("timeline") },
  storePose: { keys: "K", group: "Timeline", label: "Store a key pose", run: storePose },
  play: { keys: "Space", group: "Timeline", label: "Play", run: play },
} satisfies Record<string, Action>;

export type ActionName = keyof typeof ACTIONS;
export const LIST: readonly Action[] = Object.values(ACTIONS);
