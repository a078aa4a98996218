import { describe, expect, it } from "vitest";

import {
  apply,
  IDENTITY,
  matrixOf,
  relative,
  REST,
  type Frame,
  type Transform,
  type Vec3,
} from "../../src/posing/affine";
import { EMPTY_SCENE, mirrored, posePoint, sameScene, type Column, type Scene } from "../../src/posing/columns";
import { columnMatrix } from "../../src/viewer/scene";
import { madeColumn } from "./made_column";

const column = (part: Partial<Column>): Column => madeColumn([1, 0.75, 0, 0], part);

const scene = (columns: Column[], part: Partial<Scene> = {}): Scene => ({
  columns,
  defaultTransform: null,
  mirror: null,
  ...part,
});
const up = matrixOf({ ...REST, translation: [0, 1, 0] }, [0, 0, 0]);

describe("posePoint", () => {
  const point: Vec3 = [1, 2, 3];

  it("leaves a point in place if all columns are at rest", () => {
    expect(posePoint(scene([column({}), column({})]), point, 0)).toEqual(point);
  });

  it("adds the weighted motions of all columns", () => {
    expect(posePoint(scene([column({ transform: up })]), point, 1)[1]).toBeCloseTo(2.75, 4);
    const both = scene([column({ transform: up }), column({ transform: up })]);
    expect(posePoint(both, point, 1)[1]).toBeCloseTo(3.5, 4);
  });

  it("moves by D₀ with the weight 1 minus the sum of all weights (Eq. 1)", () => {
    const down = scene([column({})], { defaultTransform: matrixOf({ ...REST, translation: [0, -1, 0] }, [0, 0, 0]) });
    expect(posePoint(down, point, 0)[1]).toBeCloseTo(2, 4);
    expect(posePoint(down, point, 1)[1]).toBeCloseTo(1.75, 4);
    expect(posePoint(down, point, 2)[1]).toBeCloseTo(1, 4);
    expect(posePoint({ ...down, columns: [column({}), column({})] }, point, 1)[1]).toBeCloseTo(2, 4);
  });

  it("mirrors on the other side of the plane (Eq. 8), smoothly within the band", () => {
    const mirror = { normal: [1, 0, 0] as Vec3, offset: 0, band: 0.5 };
    const right = column({ transform: matrixOf({ ...REST, translation: [1, 0, 0] }, [0, 0, 0]) });
    const x = (at: number) => posePoint(scene([right], { mirror }), [at, 0, 0], 0)[0];
    expect(x(2)).toBeCloseTo(3, 6);
    expect(x(-2)).toBeCloseTo(-3, 6);
    expect(x(0)).toBeCloseTo(0, 6);
    expect(x(0.25)).toBeCloseTo(0.25 + (2 * 0.84375 - 1), 6);
  });
});

describe("transforms", () => {
  it("can be converted to coordinates relative to a center", () => {
    const turn = matrixOf({ ...REST, rotation: [0, 0, 90] }, [10, 0, 0]);
    const moved = apply(relative(turn, [10, 0, 0]), [1, 0, 0]);
    [0, 1, 0].forEach((x, i) => expect(moved[i]).toBeCloseTo(x, 10));
  });

  it("move a mirrored point to the mirror image of the moved point", () => {
    const mirror = { normal: [0, 0, 1] as Vec3, offset: 1, band: 0 };
    const turn = matrixOf({ ...REST, rotation: [20, 30, 40], translation: [1, 2, 3] }, [1, 1, 1]);
    const flip = (p: Vec3): Vec3 => [p[0], p[1], 2 - p[2]];
    const [a, b] = [apply(mirrored(turn, mirror), [0.3, 0.7, 2]), flip(apply(turn, flip([0.3, 0.7, 2])))];
    a.forEach((x, i) => expect(x).toBeCloseTo(b[i], 10));
  });

  it("move a counterpart in its frame as they move the handle", () => {
    const frame: Frame = [
      [-1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ];
    const at = (transform: Partial<Transform>) =>
      columnMatrix(
        { position: [2, 0, 0], transform: { ...REST, ...transform } },
        { column: 1, frame, position: [-2, 0, 0] },
      );
    const other = at({ rotation: [0, 0, 90], translation: [1, 0, 0], pivot: [1, 0, 0] });
    // The translation of the pivot is mirrored, and the rotation has the opposite direction.
    [-2, 0, 0].forEach((x, i) => expect(apply(other, [-1, 0, 0])[i]).toBeCloseTo(x, 10));
    [-2, 1, 0].forEach((x, i) => expect(apply(other, [-2, 0, 0])[i]).toBeCloseTo(x, 10));
    [-3, 1, 0].forEach((x, i) =>
      expect(apply(at({ rotation: [0, 0, 90], pivot: [3, 1, 0] }), [-3, 1, 0])[i]).toBeCloseTo(x, 10),
    );
  });
});

describe("sameScene", () => {
  const mirror = { normal: [1, 0, 0], offset: 0, band: 0 } as const;
  const one = scene([column({})], { defaultTransform: IDENTITY, mirror });

  it("is true for different objects with equal numbers", () => {
    const columns = [{ ...one.columns[0], transform: IDENTITY.clone() }];
    const copy = { columns, defaultTransform: IDENTITY.clone(), mirror: { ...mirror, normal: [1, 0, 0] as const } };
    expect(sameScene(one, copy)).toBe(true);
  });

  it.each<[string, Scene]>([
    ["columns", EMPTY_SCENE],
    ["column", scene([madeColumn([0])], { defaultTransform: IDENTITY, mirror })],
    ["transform", scene([{ ...one.columns[0], transform: up }], { defaultTransform: IDENTITY, mirror })],
    ["D₀", { ...one, defaultTransform: null }],
    ["mirror", { ...one, mirror: { ...mirror, normal: [0, 1, 0] } }],
    ["band", { ...one, mirror: { ...mirror, band: 1 } }],
  ])("is false for a different %s", (_, other) => expect(sameScene(one, other)).toBe(false));
});
