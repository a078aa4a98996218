/** Every key of the page, in one table that the overlay shows too. */

import { alive, store, type State } from "../store/state";
import * as edit from "./edit";
import { chooseFiles } from "./files";
import { play, storePose } from "./timeline";

export interface Shortcut {
  readonly keys: string;
  readonly group: "Handle" | "View" | "Edit" | "Tools" | "Timeline";
  readonly label: string;
  /** `event.key`, in lower case, and whether Ctrl or Cmd and Shift are held. */
  readonly match: { readonly key: string; readonly control?: boolean; readonly shift?: boolean };
  readonly run: () => void;
}

const LOOKS = ["texture", "clay", "features", "heat"] as const;
const set = (change: Partial<State>) => () => store.set(change);

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

export function shortcuts(frame: () => void): readonly Shortcut[] {
  return [
    { keys: "W", group: "Handle", label: "Move", match: { key: "w" }, run: set({ gizmo: "translate", tool: "hold" }) },
    { keys: "E", group: "Handle", label: "Rotate", match: { key: "e" }, run: set({ gizmo: "rotate", tool: "hold" }) },
    { keys: "R", group: "Handle", label: "Scale", match: { key: "r" }, run: set({ gizmo: "scale", tool: "hold" }) },
    {
      keys: "L",
      group: "Handle",
      label: "Local or world axes",
      match: { key: "l" },
      run: () => store.set({ space: store.get().space === "world" ? "local" : "world" }),
    },
    {
      keys: "S",
      group: "Handle",
      label: "Snap",
      match: { key: "s" },
      run: () => store.set({ snap: !store.get().snap }),
    },
    {
      keys: "]",
      group: "Handle",
      label: "More reach",
      match: { key: "]" },
      run: withSelected((h) => edit.wheelReach(h, 1.08)),
    },
    {
      keys: "[",
      group: "Handle",
      label: "Less reach",
      match: { key: "[" },
      run: withSelected((h) => edit.wheelReach(h, 1 / 1.08)),
    },
    { keys: "N", group: "Handle", label: "Next handle", match: { key: "n" }, run: () => cycle(1) },
    {
      keys: "Shift N",
      group: "Handle",
      label: "Previous handle",
      match: { key: "n", shift: true },
      run: () => cycle(-1),
    },
    { keys: "0", group: "Handle", label: "Return to rest", match: { key: "0" }, run: withSelected(edit.resetOne) },
    { keys: "Delete", group: "Handle", label: "Remove", match: { key: "delete" }, run: withSelected(edit.remove) },
    {
      keys: "Esc",
      group: "Handle",
      label: "Let go of the selection",
      match: { key: "escape" },
      run: () => edit.select(null),
    },
    { keys: "H", group: "Tools", label: "Hold points", match: { key: "h" }, run: set({ tool: "hold" }) },
    { keys: "X", group: "Tools", label: "Fix points", match: { key: "x" }, run: set({ tool: "fix" }) },
    { keys: "B", group: "Tools", label: "Brush", match: { key: "b" }, run: set({ tool: "paint" }) },
    { keys: "P", group: "Tools", label: "Move the pivot", match: { key: "p" }, run: set({ tool: "pivot" }) },
    { keys: "G", group: "Tools", label: "Suggest handles", match: { key: "g" }, run: edit.suggest },
    {
      keys: "Shift G",
      group: "Tools",
      label: "Hold the next suggestion",
      match: { key: "g", shift: true },
      run: holdNext,
    },
    { keys: "1 … 4", group: "View", label: "Texture, clay, features, heat map", match: { key: "1" }, run: look(0) },
    ...[1, 2, 3].map((i): Shortcut => ({
      keys: "",
      group: "View",
      label: "",
      match: { key: String(i + 1) },
      run: look(i),
    })),
    {
      keys: "Z",
      group: "View",
      label: "Wireframe",
      match: { key: "z" },
      run: () => store.set({ wireframe: !store.get().wireframe }),
    },
    {
      keys: "Q",
      group: "View",
      label: "Full quality while moving",
      match: { key: "q" },
      run: () => store.set({ quality: store.get().quality === "auto" ? "full" : "auto" }),
    },
    { keys: "F", group: "View", label: "Frame the shape", match: { key: "f" }, run: frame },
    {
      keys: "I",
      group: "View",
      label: "Inspector",
      match: { key: "i" },
      run: () => store.set({ inspector: !store.get().inspector }),
    },
    {
      keys: "?",
      group: "View",
      label: "These keys",
      match: { key: "?", shift: true },
      run: () => store.set({ help: !store.get().help }),
    },
    { keys: "Ctrl Z", group: "Edit", label: "Undo", match: { key: "z", control: true }, run: edit.undo },
    {
      keys: "Ctrl Shift Z",
      group: "Edit",
      label: "Redo",
      match: { key: "z", control: true, shift: true },
      run: edit.redo,
    },
    { keys: "Ctrl O", group: "Edit", label: "Open a file", match: { key: "o", control: true }, run: chooseFiles },
    {
      keys: "T",
      group: "Timeline",
      label: "Timeline",
      match: { key: "t" },
      run: () => store.set({ timeline: !store.get().timeline }),
    },
    { keys: "K", group: "Timeline", label: "Store a key pose", match: { key: "k" }, run: storePose },
    { keys: "Space", group: "Timeline", label: "Play", match: { key: " " }, run: play },
  ];
}

/** Held, not pressed, so it has a place of its own. */
export const COMPARE = { keys: "C", group: "View", label: "Hold to see the original" } as const;

function look(i: number): () => void {
  return () => store.set({ look: LOOKS[i] });
}

export function listen(frame: () => void): void {
  const table = shortcuts(frame);
  addEventListener("keydown", (event) => {
    const target = event.target as HTMLElement;
    if (target.matches("input:not([type=range], [type=checkbox]), textarea, select")) return;
    if (event.key.toLowerCase() === "c" && !event.ctrlKey && !event.metaKey && !event.repeat) {
      if (alive(store.get())) store.set({ comparing: true });
      return;
    }
    if (event.key === " " && target.matches("button, input, [role=menuitem]")) return;
    const { help, page } = store.get();
    if (event.key === "Escape" && help) {
      store.set({ help: false });
      return;
    }
    const key = event.key === "Backspace" ? "delete" : event.key.toLowerCase();
    const control = event.ctrlKey || event.metaKey;
    const found = table.find(
      ({ match }) =>
        match.key === key &&
        (match.control ?? false) === control &&
        // Where "?" lies under Shift differs from keyboard to keyboard.
        (match.key === "?" || (match.shift ?? false) === event.shiftKey),
    );
    if (!found || (page !== "shape" && found.label !== "These keys" && found.label !== "Open a file")) return;
    event.preventDefault();
    found.run();
  });
  addEventListener("keyup", (event) => {
    if (event.key.toLowerCase() === "c") store.set({ comparing: false });
  });
  addEventListener("blur", () => store.set({ comparing: false }));
}
