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

  it("holds the first and the last pose beyond the ends", () => {
    expect(momentAt(poses, 0).get(1)?.translation).toEqual([0, 0, 0]);
    expect(momentAt(poses, 9).get(1)?.translation).toEqual([0, 4, 0]);
  });

  it("lies between its neighbors", () => {
    expect(momentAt(poses, 1.5).get(1)?.translation).toEqual([0, 1, 0]);
  });

  it("has handles rest where a pose does not name them", () => {
    const mixed = [pose(0, 2, 1), pose(1, 2, 2)];
    expect(momentAt(mixed, 0.5).get(1)?.translation).toEqual([0, 1, 0]);
    expect(momentAt(mixed, 1).get(1)).toEqual(REST);
  });
});
