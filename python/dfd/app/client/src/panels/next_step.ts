/** Tell the user what to do next, in one line. */

import { reachText } from "../actions/edit";
import { present, ready, selectedHandle, stepText, type State } from "../store/state";
import { held } from "../viewer/scene";
import { percent } from "../widgets/controls";

const HINTS = {
  fix: "Click a point to fix it: the colored surface stays · click it again to release it · H ends",
  paint: "Paint the shape · Shift erases · right button orbits · Esc ends",
  box: "Draw a box over the shape · Shift erases · right button orbits · Esc ends",
  marks: "Click a point to place a mark · drag the mark to where it must arrive · Esc ends",
  pivot: "Drag the gizmo to move the pivot of the selected handle · Esc ends",
} as const;
const MOTIONS = { translate: "Move", rotate: "Rotate", scale: "Scale", bend: "Bend" } as const;
const GRIPS = { translate: "an arrow", rotate: "a ring", scale: "a cube", bend: "the tip" } as const;

/** Entries of the menu in place of keys. */
const IN_MENU: Record<string, string> = {
  "X fixes a point": "menu: fix points",
  "K stores a pose": "menu: timeline",
};

/** Return the words with "Tap" in place of "Click" on a touch screen, and without keys. */
function onTouch(words: string): string {
  const said = words.split(" · ").map((part) => IN_MENU[part] ?? part);
  const parts = said.filter((part) => !/^([A-Z] |Esc|wheel|Shift|right)/.test(part));
  return parts
    .join(" · ")
    .replace("[ ]", "inspector:")
    .replace(/\bClick\b/g, "Tap")
    .replace(/\bclick\b/g, "tap");
}

/** Return when parts can be held. The parts of the geometry are found soon, unless the user stopped the work. */
export function whenReady({ edit }: Pick<State, "edit">): string {
  return edit?.field.status === "none" ? "after the features are learned" : "in a moment";
}

export function nextStep(state: State, touch = matchMedia("(pointer: coarse)").matches): string {
  return touch ? `${tapped(state)}${onTouch(words(state))}` : words(state);
}

/** Return the part that a tap took, because a finger cannot hover. */
function tapped(state: State): string {
  const handle = selectedHandle(state);
  const step = handle && !state.dragging ? stepText(state, handle.origin, handle.level) : "";
  return step && `${step} · `;
}

function words(state: State): string {
  const { tool, comparing, typed, gizmo, dragging, painted, probe, selected, moment, axis, marked } = state;
  const known = selectedHandle(state);
  const handle = known && present(state, known);
  if (typed) {
    const along = typed.axis === null ? "" : ` ${"xyz"[typed.axis]}`;
    return `${MOTIONS[gizmo]}${along} ${typed.text || "…"} · X Y Z choose the axis · Enter keeps it · Esc cancels`;
  }
  if (marked) return "The handles follow the mark · Esc cancels";
  if (dragging)
    return handle
      ? `${reachText(handle)} · moves ${percent(held(state, handle.handle))} of the surface · wheel: less or more · or type a number`
      : "";
  if (comparing) return "The original shape · C shows the edit";
  if (moment) return "A moment of the timeline · Use this pose, or go back to the edit";
  if (!ready(state)) return `Drag to orbit · parts can be held ${whenReady(state)}`;
  if (painted) return "Fix the selection, or add a handle: the buttons are beside it";
  if (tool !== "hold") return HINTS[tool];
  if (typeof probe?.vertex === "number" && probe.vertex !== handle?.vertex) {
    const step = stepText(state, probe.vertex, probe.level);
    return `${step ? `${step} · ` : ""}click to hold it · wheel or [ ]: a smaller or larger part`;
  }
  if (!handle)
    return state.edit?.handles.length
      ? "Click a handle to change it, or another part to hold it · drag to orbit"
      : "Click a part to hold it: all parts like it follow · drag to orbit";
  const bends = gizmo !== "bend" || axis?.handle !== selected || axis.bends !== null;
  if (!bends) return "This part cannot bend · [ ] smaller or larger part · W moves";
  const again = handle.moved ? "click another part · X fixes a point · K stores a pose" : "[ ] smaller or larger";
  const modes = gizmo === "bend" ? "W moves" : "D bends";
  return `Drag ${GRIPS[gizmo]} · ${again} · ${modes}`;
}
