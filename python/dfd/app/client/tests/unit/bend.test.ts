import { describe, expect, it } from "vitest";

import type { Vec3 } from "../../src/posing/affine";
import { bendTowards, bentTip } from "../../src/posing/bend";

const CURVE = [
  ...([
    [0, 0, 0],
    [0.1228, 0.2462, 0.0046],
    [0.2439, 0.4929, 0.0184],
  ] as const),
  ...([
    [0.3617, 0.7405, 0.0413],
    [0.4746, 0.9893, 0.0736],
    [0.5808, 1.2397, 0.1155],
  ] as const),
  ...([
    [0.6784, 1.4917, 0.167],
    [0.7659, 1.7453, 0.2285],
    [0.8415, 2, 0.3],
  ] as const),
];
const AXIS = {
  nodes: CURVE.map((node) => [...node] as [number, number, number]),
  radius: CURVE.map(() => 0.2),
  slender: true,
  carry: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ] as [[number, number, number], [number, number, number], [number, number, number]],
};
const TIP = CURVE[8];

describe("a part that bends", () => {
  it("keeps its tip without a bend", () => {
    bentTip(AXIS, [0, 0, 0], null).forEach((x, i) => expect(x).toBeCloseTo(TIP[i], 9));
  });

  // The tips are those of `dfd.posing.bend.bend_maps`.
  it.each([
    [[0, 0, 90], null, [-0.51844, 1.78802, 0.3]],
    [[40, -30, 100], null, [-0.65215, 1.39976, 0.71739]],
    [[0, 0, 90], 0.5, [-0.56729, 1.43532, 0.3]],
    [[60, 0, 20], 0.2, [0.39613, 1.08086, 1.63611]],
  ] as [Vec3, number | null, Vec3][])("puts its tip where the kernel does: %j, joint %d", (bend, joint, wanted) => {
    const tip = bentTip(AXIS, bend, joint);
    expect(Math.hypot(...tip.map((x, i) => x - wanted[i]))).toBeLessThan(0.003);
  });

  it("rotates as a whole if it is stout, and bends as its counterpart's matrix says", () => {
    const stout = { ...AXIS, nodes: [AXIS.nodes[0], AXIS.nodes[8]], slender: false };
    const tip = bentTip(stout, [0, 0, 90], 0.5);
    [-TIP[1], TIP[0], TIP[2]].forEach((x, i) => expect(tip[i]).toBeCloseTo(x, 9));
    const half = { ...stout, carry: AXIS.carry.map((row) => row.map((x) => x / 2)) as typeof AXIS.carry };
    expect(bentTip(half, [0, 0, 180], null)).toEqual(tip);
  });

  it.each([0, 30, 60, 100, 140])("finds the bend by %d° again from the place of the tip", (angle) => {
    const bend: Vec3 = [angle * 0.8, 0, angle * 0.6];
    const place = bentTip(AXIS, bend, null);
    const found = bendTowards(AXIS, [10, 0, 0], null, (tip) => tip.map((x, i) => x - place[i]));
    const off = Math.hypot(...bentTip(AXIS, found, null).map((x, i) => x - place[i]));
    expect(off).toBeLessThan(0.02);
  });

  it("follows small motions by as much", () => {
    let bend: Vec3 = [0, 0, 0];
    for (let step = 1; step <= 10; step++) {
      const wanted = TIP[2] + 0.05 * step;
      bend = bendTowards(AXIS, bend, null, (tip) => [tip[2] - wanted]);
      expect(bentTip(AXIS, bend, null)[2]).toBeCloseTo(wanted, 3);
    }
    expect(Math.hypot(...bend)).toBeLessThan(90);
  });

  it("bends by at most 300°", () => {
    const bend = bendTowards(AXIS, [0, 0, 299], null, (tip) => [100 - tip[0], tip[1] + 100]);
    expect(Math.hypot(...bend)).toBeLessThanOrEqual(300.001);
  });
});
