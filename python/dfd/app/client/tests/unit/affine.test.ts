import { Quaternion } from "three";
import { describe, expect, it } from "vitest";

import {
  apply,
  axisIn,
  IDENTITY,
  interpolate,
  matrixOf,
  quaternionOf,
  reflection,
  REST,
  rotationOf,
  typedMotion,
  type Frame,
  type Transform,
  type Vec3,
} from "../../src/posing/affine";
import { REST_VALUES } from "../../src/protocol/messages";

function close(a: readonly number[], b: readonly number[], digits = 10): void {
  expect(a.length).toBe(b.length);
  a.forEach((x, i) => expect(x).toBeCloseTo(b[i], digits));
}

describe("matrixOf", () => {
  it("is exactly the identity at rest, about any pivot", () => {
    expect(matrixOf({ ...REST, pivot: [3, -2, 7.1] }, [0, 0, 0]).equals(IDENTITY)).toBe(true);
  });

  const diagonal: Frame = [
    [Math.SQRT1_2, Math.SQRT1_2, 0],
    [-Math.SQRT1_2, Math.SQRT1_2, 0],
    [0, 0, 1],
  ];
  it.each([
    [{ translation: [0, 0, 5], rotation: [0, 0, 90], scale: [2, 1, 1], pivot: [1, 0, 0] }, [2, 0, 0], [1, 2, 5]],
    [{ scale: [3, 1, 1], axes: diagonal, pivot: [0, 0, 0] }, [1, 1, 5], [3, 3, 5]],
    [{ scale: [3, 1, 1], axes: diagonal, pivot: [0, 0, 0] }, [-1, 1, 5], [-1, 1, 5]],
    [{ rotation: [0, 180, 0] }, [2, 1, 1], [0, 1, 1]], // about the center
  ] as [Partial<Transform>, Vec3, Vec3][])("of %j moves %j to %j", (part, from, to) => {
    close(apply(matrixOf({ ...REST, ...part }, [1, 1, 1]), from), to);
  });
});

describe("rotations", () => {
  it("are the same after conversion to a quaternion and back, up to 180°", () => {
    const turns: Vec3[] = [
      [0, 0, 0],
      [30, -40, 50],
      [179, 0, 0],
      [0, 1e-5, 0],
    ];
    for (const turn of turns) close(rotationOf(quaternionOf(turn)), turn, 6);
    close(rotationOf(quaternionOf([0, 270, 0])), [0, -90, 0], 6);
    close(rotationOf(new Quaternion(0, 0, 0, -1)), [0, 0, 0]);
  });

  it("goes on beyond half a turn", () => {
    for (let angle = 0, near: Vec3 = [0, 0, 0]; angle <= 720; angle += 60) {
      near = rotationOf(quaternionOf([0, 0, angle]), near);
      close(near, [0, 0, angle], 6);
    }
  });
});

describe("interpolate", () => {
  it("returns both ends, and the mean at 0.5", () => {
    const b: Transform = { ...REST, translation: [2, 4, 6], rotation: [0, 90, 0], scale: [3, 1, 1], twist: 4 };
    expect(interpolate(REST, b, 0).translation).toEqual([0, 0, 0]);
    close(interpolate(REST, b, 1).rotation, [0, 90, 0], 8);
    const half = interpolate(REST, b, 0.5);
    close(half.rotation, [0, 45, 0], 8);
    expect([half.scale, half.twist]).toEqual([[2, 1, 1], 2]);
  });
});

describe("reflection", () => {
  it("is its own inverse and does not move the plane", () => {
    const across = reflection([0.6, 0.8, 0], 2);
    close(across.clone().multiply(across).elements, IDENTITY.elements);
    close(apply(across, [1.2, 1.6, 5]), [1.2, 1.6, 5]);
  });
});

describe("typedMotion", () => {
  const turned: Transform = { ...REST, rotation: [0, 0, 90], scale: [1, 2, 1] };

  it("adds a translation, a rotation or a bend, and multiplies the scale", () => {
    const along = (axis: number | null, local = false) => axisIn(turned, axis, local);
    close(typedMotion(REST, "translate", along(1), 0.2).translation, [0, 0.2, 0]);
    close(typedMotion(REST, "translate", along(null), 0.2).translation, [0.2, 0, 0]);
    close(typedMotion(turned, "rotate", along(2), -30).rotation, [0, 0, 60]);
    // The typed rotation follows the rotation of the handle: x points to y, and then y to z.
    const both = typedMotion(turned, "rotate", along(0), 90);
    close(apply(matrixOf({ ...both, scale: [1, 1, 1] }, [0, 0, 0]), [1, 0, 0]), [0, 0, 1]);
    close(typedMotion({ ...REST, bend: [0, 0, 5] }, "bend", along(0), 40).bend, [40, 0, 5]);
    close(typedMotion(turned, "scale", along(null), 3).scale, [3, 6, 3]);
    close(typedMotion(turned, "scale", along(1), 3).scale, [1, 6, 1]);
    expect(typedMotion(turned, "scale", null, 0)).toBe(turned);
  });

  it("uses the axes of the rotated handle on request", () => {
    close(typedMotion(turned, "translate", axisIn(turned, 0, true), 0.2).translation, [0, 0.2, 0]);
  });
});

it("has the values at rest of the server", () => {
  expect(REST).toEqual(REST_VALUES);
});
