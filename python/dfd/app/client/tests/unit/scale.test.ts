import { describe, expect, it } from "vitest";

import { pulledScale, stepped } from "../../src/posing/scale";

describe("a scale by pixels", () => {
  it("doubles when the pointer moves by the arm, from wherever it began", () => {
    expect(pulledScale([1, 1, 1], [0, 1, 2], 80, 80, false)).toEqual([2, 2, 2]);
    expect(pulledScale([2, 3, 1], [0], 40, 80, false)).toEqual([3, 3, 1]);
  });

  it("never flips and never vanishes", () => {
    for (const pixels of [-80, -200, -1e6])
      expect(pulledScale([1, 1, 1], [1], pixels, 80, false)).toEqual([1, 0.01, 1]);
    expect(pulledScale([1, 1, 1], [1], -200, 80, true)).toEqual([1, 0.1, 1]);
  });

  it("snaps the factor, not the scale", () => {
    expect(pulledScale([1.234, 1, 1], [0], 11, 80, true)[0]).toBeCloseTo(1.234 * 1.1, 12);
    expect(stepped(0.128, 0.02)).toBe(0.12);
    expect(stepped(-37, 15)).toBe(-30);
  });
});
