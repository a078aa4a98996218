import { describe, expect, it } from "vitest";

import { nextStep } from "../../src/panels/next_step";
import type { HandleState, LadderMessage, StateMessage } from "../../src/protocol/messages";
import { stepAt, store, type State } from "../../src/store/state";

const handle = { handle: 1, vertex: 7, origin: 7, region: 0, reach_by: "part", level: 0, moved: false } as HandleState;
const steps = [-1, 0, 2].map((level) => ({
  level,
  text: `part ${level}`,
  share: 0.1,
  alike: 1,
  found: true,
  leaves: false,
}));
const ladder: LadderMessage = { id: 1, type: "ladder", vertex: 7, steps };
const edit = { field: { status: "ready", parts: ["larger"] }, handles: [] } as unknown as StateMessage;
const stopped = { ...edit, field: { ...edit.field, status: "none" } } as StateMessage;
const rests: State = { ...store.get(), edit, ladders: new Map([[7, ladder]]) };
const held: State = { ...rests, selected: 1, edit: { ...edit, handles: [handle] } };
const moved: State = { ...held, edit: { ...edit, handles: [{ ...handle, moved: true }] } };

describe("nextStep", () => {
  it.each<[string, Partial<State>, RegExp]>([
    ["a shape without handles", rests, /^Click a part/],
    [
      "a pointer on a part",
      { ...rests, probe: { vertex: 7, level: 2, exact: false, weights: new Uint16Array() } },
      /^3 of 3: part 2 · click/,
    ],
    ["a new handle", held, /^Drag an arrow · \[ \] smaller or larger · D bends/],
    ["a handle that bends", { ...held, gizmo: "bend" }, /^Drag the tip · .*W moves/],
    ["a moved handle", moved, /^Drag an arrow · click another part/],
    ["a painted region", { ...rests, painted: { weights: new Uint16Array(), count: 1 } }, /^Fix the selection/],
    ["marks", { ...held, tool: "marks" }, /^Click a point to place a mark .*Esc ends$/],
    ["a dragged mark", { ...held, tool: "marks", marked: { index: 0, target: [0, 0, 0] }, dragging: true }, /follow/],
    ["a typed number", { ...held, typed: { axis: 2, text: "4" } }, /^Move z 4 .*Enter keeps it · Esc cancels/],
    ["parts that are being found", { ...rests, edit: null }, /^Drag to orbit .* in a moment$/],
    [
      "features that were not learned",
      { ...rests, edit: stopped },
      /^Drag to orbit .* after the features are learned$/,
    ],
  ])("follows %s", (_, state, wanted) => {
    expect(nextStep(state as State, false)).toMatch(wanted);
  });

  it("names no keys on a touch screen", () => {
    expect(nextStep(rests, true)).toMatch(/^Tap a part/);
    expect(nextStep(held, true)).toBe("2 of 3: part 0 · Drag an arrow · inspector: smaller or larger");
    expect(nextStep(moved, true)).toBe(
      "2 of 3: part 0 · Drag an arrow · tap another part · menu: fix points · menu: timeline",
    );
  });
});

describe("stepAt", () => {
  it.each([
    [-9, 0],
    [0, 1],
    [1, 2],
    [9, 2],
  ])("of level %d is %d", (level, index) => {
    expect(stepAt(ladder, level)).toBe(index);
  });
});
