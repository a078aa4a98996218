import { describe, expect, it } from "vitest";

import { momentAt } from "../../src/actions/timeline";
import type { KeyPose } from "../../src/protocol/messages";
import { REST } from "../../src/posing/affine";

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
});
