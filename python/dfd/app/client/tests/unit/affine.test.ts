import { describe, expect, it } from "vitest";

import {
  apply,
  IDENTITY,
  interpolate,
  matrixOf,
  multiply,
  quaternionOf,
  reflection,
  REST,
  rotationOf,
  type Transform,
  type Vec3,
} from "../../src/posing/affine";

function close(a: readonly number[], b: readonly number[], digits = 10): void {
  expect(a.length).toBe(b.length);
  a.forEach((x, i) => expect(x).toBeCloseTo(b[i], digits));
}

describe("matrixOf", () => {
  it("is the identity at rest, about any pivot", () => {
    close(matrixOf({ ...REST, pivot: [3, -2, 7] }, [0, 0, 0]), IDENTITY);
  });

  it("scales, then turns, then moves, about the pivot", () => {
    const transform: Transform = {
      ...REST,
      translation: [0, 0, 5],
      rotation: [0, 0, 90],
      scale: [2, 1, 1],
      pivot: [1, 0, 0],
    };
    close(apply(matrixOf(transform, [9, 9, 9]), [2, 0, 0]), [1, 2, 5]);
  });

  it("scales along axes of its own", () => {
    const axes = [
      [Math.SQRT1_2, Math.SQRT1_2, 0],
      [-Math.SQRT1_2, Math.SQRT1_2, 0],
      [0, 0, 1],
    ] as const;
    const matrix = matrixOf({ ...REST, scale: [3, 1, 1], axes }, [0, 0, 0]);
    close(apply(matrix, [1, 1, 5]), [3, 3, 5]);
    close(apply(matrix, [-1, 1, 5]), [-1, 1, 5]);
  });

  it("turns about the handle's own place where there is no pivot", () => {
    close(apply(matrixOf({ ...REST, rotation: [0, 180, 0] }, [1, 1, 1]), [2, 1, 1]), [0, 1, 1]);
  });
});

describe("rotations", () => {
  it("come back from a quaternion, up to half a turn", () => {
    const turns: Vec3[] = [
      [0, 0, 0],
      [30, -40, 50],
      [179, 0, 0],
      [0, 1e-5, 0],
    ];
    for (const turn of turns) close(rotationOf(quaternionOf(turn)), turn, 6);
    close(rotationOf(quaternionOf([0, 270, 0])), [0, -90, 0], 6);
  });
});

describe("interpolate", () => {
  it("reaches both ends and is halfway in the middle", () => {
    const a: Transform = REST;
    const b: Transform = { ...REST, translation: [2, 4, 6], rotation: [0, 90, 0], scale: [3, 1, 1] };
    expect(interpolate(a, b, 0).translation).toEqual([0, 0, 0]);
    close(interpolate(a, b, 1).rotation, [0, 90, 0], 8);
    const half = interpolate(a, b, 0.5);
    close(half.rotation, [0, 45, 0], 8);
    expect(half.scale).toEqual([2, 1, 1]);
  });

  it("turns along the shorter arc", () => {
    const turned = (degrees: number): Transform => ({ ...REST, rotation: [0, 0, degrees] });
    expect(Math.abs(interpolate(turned(170), turned(-170), 0.5).rotation[2])).toBeCloseTo(180, 6);
    close(interpolate(turned(10), turned(10), 0.3).rotation, [0, 0, 10]);
  });
});

describe("reflection", () => {
  it("undoes itself and leaves the plane where it is", () => {
    const across = reflection([0.6, 0.8, 0], 2);
    close(multiply(across, across), IDENTITY);
    close(apply(across, [1.2, 1.6, 5]), [1.2, 1.6, 5]);
  });
});
