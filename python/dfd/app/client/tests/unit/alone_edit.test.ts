import { describe, expect, it } from "vitest";

import { AT_REST, controlled, History, moved, NO_EDIT, posed, withHandle, type Edit } from "../../src/alone/edit";
import type { HandleState } from "../../src/protocol/messages";

const HANDLE = {
  handle: 1,
  name: null,
  vertex: 5,
  position: [1, 2, 3],
  translation: [0, 0, 0],
  rotation: [0, 0, 0],
  scale: [1, 1, 1],
  pivot: [1, 2, 3],
  pivot_set: false,
  pivot_at: null,
  axes: null,
  reach: 0.5,
  reach_by: "part",
  level: true,
  falloff: "smooth",
  strength: 1,
  moved: false,
} as unknown as HandleState;
const HELD: Edit = { ...NO_EDIT, handles: [HANDLE] };
const to = (x: number): Edit => withHandle(HELD, 1, (handle) => moved(handle, { translation: [x, 0, 0] }));

describe("a handle", () => {
  it("is moved by what is given, about the pivot that is given", () => {
    const turned = moved(HANDLE, {
      rotation: [0, 90, 0],
      pivot: [0, 0, 1],
      bend: [0, 0, 0],
      twist: 0,
      joint: "spread",
    });
    expect(turned).toMatchObject({ rotation: [0, 90, 0], pivot: [0, 0, 1], pivot_set: true, moved: true });
    expect(moved(turned, AT_REST)).toMatchObject({ rotation: [0, 0, 0], pivot: [0, 0, 1], moved: false });
    expect(moved(turned, { pivot: "auto" })).toMatchObject({ pivot: [1, 2, 3], pivot_set: false });
    expect(moved(HANDLE, { pivot: "point" })).toMatchObject({ pivot: [1, 2, 3], pivot_set: true, pivot_at: "point" });
  });

  it("takes a whole pose", () => {
    const pose = { handle: 1, translation: [1, 0, 0], rotation: [0, 0, 0], scale: [1, 1, 1] } as const;
    expect(posed(moved(HANDLE, { pivot: [9, 9, 9] }), pose)).toMatchObject({ pivot_set: false, moved: true });
  });

  it("weighs by its part, or by a number without the look-alikes in full", () => {
    const numbered = controlled(HANDLE, { reach: 0.3, falloff: "sharp" });
    expect(numbered).toMatchObject({ reach: 0.3, reach_by: "number", level: false, falloff: "sharp" });
    expect(controlled(numbered, { strength: 0.5 })).toMatchObject({ reach: 0.3, reach_by: "number", strength: 0.5 });
    expect(controlled(numbered, { reach: "part" })).toMatchObject({ reach_by: "part", level: true });
    expect(controlled(HANDLE, { name: "ear" })).toMatchObject({ reach_by: "part", level: true });
  });

  it("refuses what takes a server", () => {
    for (const transform of [{ bend: 3 }, { twist: 1 }, { joint: 0.5 }, { axes: "normal" }, { pivot: "base" }] as const)
      expect(() => moved(HANDLE, transform)).toThrow("takes the app");
    for (const controls of [{ locality: 2 }, { reach: "auto" }, { level: true }, { radius: 1 }] as const)
      expect(() => controlled(HANDLE, controls)).toThrow("takes the app");
    expect(() => withHandle(HELD, 2, (handle) => handle)).toThrow("no handle 2");
  });
});

describe("steps", () => {
  it("of one topic join, are undone at once and done again", () => {
    const history = new History(HELD);
    history.set(to(1), "move");
    history.set(to(2), "move", true);
    history.set(to(3), "move");
    history.undo();
    expect(history.present).toEqual(to(2));
    history.undo();
    expect([history.present, history.canUndo, history.canRedo]).toEqual([HELD, false, true]);
    history.undo();
    history.redo();
    expect(history.present).toEqual(to(2));
    // What was undone is another step than what comes now, and is lost by it.
    history.set(to(4), "move", true);
    expect(history.canRedo).toBe(false);
    history.undo();
    expect(history.present).toEqual(to(2));
  });
});
