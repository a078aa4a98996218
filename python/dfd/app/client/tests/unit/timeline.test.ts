import { describe, expect, it } from "vitest";

import { eased, momentAt } from "../../src/actions/timeline";
import type { KeyPose } from "../../src/protocol/messages";
import { REST } from "../../src/posing/affine";
import shared from "./moments.json";

const pose = (seconds: number, y: number, handle = 1): KeyPose => ({
  name: `at ${seconds}`,
  seconds,
  transforms: [{ handle, translation: [0, y, 0], rotation: [0, 0, 0], scale: [1, 1, 1], pivot: null }],
});

describe("momentAt", () => {
  const poses = [pose(1, 0), pose(3, 4)];

  it("returns the first pose before it, and the last pose after it", () => {
    expect(momentAt(poses, 0).get(1)?.translation).toEqual([0, 0, 0]);
    expect(momentAt(poses, 9).get(1)?.translation).toEqual([0, 4, 0]);
  });

  it("interpolates between two poses", () => {
    expect(momentAt(poses, 1.5).get(1)?.translation).toEqual([0, 1, 0]);
  });

  it("returns a handle at rest if a pose does not mention it", () => {
    const mixed = [pose(0, 2, 1), pose(1, 2, 2)];
    expect(momentAt(mixed, 0.5).get(1)?.translation).toEqual([0, 1, 0]);
    expect(momentAt(mixed, 1).get(1)).toEqual(REST);
  });

  it("shows the moments of the file that the tests of exports also read", () => {
    const close = (value: unknown): unknown =>
      typeof value === "number" ? expect.closeTo(value, 9) : Array.isArray(value) ? value.map(close) : value;
    for (const { seconds, transforms } of shared.moments) {
      const shown = momentAt(shared.poses as unknown as KeyPose[], seconds);
      for (const [handle, wanted] of Object.entries<object>(transforms)) {
        const all: Record<string, unknown> = { ...REST, ...wanted };
        for (const key of Object.keys(all)) all[key] = close(all[key]);
        expect(shown.get(Number(handle))).toEqual(all);
      }
    }
  });
});

describe("eased", () => {
  it("is linear between poses that do not ease, and a smoothstep between poses that do", () => {
    for (const t of [0, 0.25, 0.5, 0.8, 1]) {
      expect(eased(t, false, false)).toBeCloseTo(t, 12);
      expect(eased(t, true, true)).toBeCloseTo(t * t * (3 - 2 * t), 12);
    }
  });

  it("is slow beside the pose that eases", () => {
    expect(eased(0.01, true, false)).toBeLessThan(0.001);
    expect(1 - eased(0.99, true, false)).toBeCloseTo(0.01, 3);
    expect(1 - eased(0.99, false, true)).toBeLessThan(0.001);
  });
});
