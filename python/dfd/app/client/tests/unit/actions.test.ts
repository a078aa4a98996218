import { describe, expect, it, vi } from "vitest";

vi.stubGlobal("matchMedia", () => ({ matches: false }));
const { ACTIONS, LIST } = await import("../../src/actions/actions");
const { regionOf } = await import("../../src/actions/edit");

describe("the actions", () => {
  it("have keys of their own", () => {
    const keys = LIST.flatMap(({ keys, also }) => [keys, ...(also ? [also] : [])]);
    expect(new Set(keys).size).toBe(keys.length);
  });

  it("redo by either of the usual keys", () => {
    expect([ACTIONS.redo.keys, ACTIONS.redo.also]).toEqual(["Ctrl Shift Z", "Ctrl Y"]);
  });
});

it("sends painted vertices as bits, from the lowest bit of a byte", () => {
  expect(regionOf(Uint16Array.from([1, 0, 9, 0, 0, 0, 0, 0, 0, 1]))).toEqual({ mask: btoa("\x05\x02") });
});
