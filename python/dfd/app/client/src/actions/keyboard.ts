/** Run actions by their keys. */

import { store } from "../store/state";
import { LIST } from "./actions";
import { typeKey } from "./edit";

const NAMES: Record<string, string> = {
  " ": "Space",
  escape: "Esc",
  enter: "Enter",
  backspace: "Delete",
  delete: "Delete",
};

/** Return the keys of an event, spelled as in `ACTIONS`. */
function keysOf({ key, code, ctrlKey, metaKey, altKey, shiftKey }: KeyboardEvent): string {
  // Shift and a digit give other characters, which depend on the keyboard layout.
  const name = /^(Numpad|Digit)\d$/.test(code) ? code.slice(-1) : (NAMES[key.toLowerCase()] ?? key.toUpperCase());
  // Some keyboard layouts need Shift for "?" or "/", so Shift is ignored for these keys.
  return `${ctrlKey || metaKey ? "Ctrl " : ""}${altKey ? "Alt " : ""}${shiftKey && !"?/".includes(name) ? "Shift " : ""}${name}`;
}

/** `grabbed` returns the axis (0 to 2) of the gizmo that the pointer holds, or null. */
export function listen(grabbed: () => number | null): void {
  addEventListener("keydown", (event) => {
    const target = event.target as HTMLElement;
    if (target.matches("input:not([type=range], [type=checkbox]), textarea, select")) return;
    // The browser closes a dialog or a menu with Esc, and other keys do nothing there.
    if (document.querySelector("dialog:modal, :popover-open")) return;
    const keys = keysOf(event);
    // Space plays the timeline even if a button has the focus. Enter presses the button.
    if (event.key === " " && target.matches("input")) return;
    const found = LIST.find((each) => each.keys === keys || each.also === keys);
    if (!typeKey(keys, grabbed())) {
      if (!found || (store.get().page !== "shape" && !found.everywhere)) return;
      found.run();
    }
    event.preventDefault();
  });
}
