import { describe, expect, it } from "vitest";

import type { Vec3 } from "../../src/posing/affine";
import { bendTowards, bentTip } from "../../src/posing/bend";

const ENDS = { base: [1, 0, 0], tip: [1, 2, 0] } as const;

describe("a part that bends", () => {
  it("does not bend if its tip stays or is moved along the axis", () => {
    expect(bentTip(ENDS, [0, 0, 0], null)).toEqual([1, 2, 0]);
    for (const point of [ENDS.tip, [1, 5, 0] as Vec3]) expect(bendTowards(ENDS, point, null)).toEqual([0, 0, 0]);
  });

  it.each([
    [[3, 2, 0], null],
    [[1, 1, -2], null],
    [[0, 1, 0.5], 0.5],
  ] as [Vec3, number | null][])("points at %j, joint %d", (point, joint) => {
    const bend = bendTowards(ENDS, point, joint);
    const tip = bentTip(ENDS, bend, joint);
    const [line, wanted] = [tip, point].map((end) => end.map((x, i) => x - ENDS.base[i]));
    const ratio = Math.hypot(...line) / Math.hypot(...wanted);
    line.forEach((x, i) => expect(x).toBeCloseTo(ratio * wanted[i], 9));
  });

  it("bends right-handed about the rotation vector, by at most 300°", () => {
    const bend = bendTowards(ENDS, [0, 0, 0], null);
    expect(bend[2]).toBeGreaterThan(90); // from +y to −x
    expect(Math.hypot(...bendTowards(ENDS, [1.001, -1, 0], null))).toBeLessThanOrEqual(300.001);
  });
});
