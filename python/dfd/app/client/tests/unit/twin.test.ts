import { describe, expect, it } from "vitest";

import { apply, IDENTITY, matrixOf, relative, REST, type Frame, type Vec3 } from "../../src/posing/affine";
import {
  CURVES,
  EMPTY_SCENE,
  mirrored,
  posePoint,
  sameScene,
  weightOf,
  type Column,
  type Falloff,
  type Layer,
  type Scene,
} from "../../src/posing/columns";
import { counterpartMatrix, counterpartPivot } from "../../src/viewer/scene";
import { madeColumn } from "./made_column";

const layer = (values: number[], scale = 2, geodesic: number[] | null = null): Layer => ({
  values: Uint16Array.from(values, (value) => Math.round((value / scale) * 65535)),
  scale,
  kind: "distance",
  geodesic: geodesic && Uint16Array.from(geodesic, (value) => Math.round(value * 65535)),
});
const weights = (values: number[]): Layer => ({ ...layer(values, 1), kind: "weight" });

const column = (part: Partial<Column>): Column => madeColumn(layer([0, 0.25, 1, 1.5]), part);

const scene = (columns: Column[], part: Partial<Scene> = {}): Scene => ({
  columns,
  defaultTransform: null,
  mirror: null,
  ...part,
});
const up = matrixOf({ ...REST, translation: [0, 1, 0] }, [0, 0, 0]);

describe("weightOf", () => {
  it("is 1 − d within reach, and 0 beyond (Eq. 5)", () => {
    [1, 0.75, 0, 0].forEach((weight, i) => expect(weightOf(column({}), i)).toBeCloseTo(weight, 4));
    expect(weightOf(column({ reach: 0.5 }), 1)).toBeCloseTo(0.5, 4);
    expect(weightOf(column({ reach: 2 }), 2)).toBeCloseTo(0.5, 4);
  });

  it("loses what fixed places hold, and is brought back to 1 at the handle (Eq. 6)", () => {
    const held = column({ fixed: weights([0.4, 0.6, 1, 1]), gain: 1 / 0.6 });
    [1, (0.75 - 0.6) / 0.6, 0].forEach((weight, i) => expect(weightOf(held, i)).toBeCloseTo(weight, 3));
  });

  it("never exceeds the strength by the gain", () => {
    expect(weightOf(column({ fixed: weights([0, 0]), gain: 2 }), 1)).toBe(1);
    expect(weightOf(column({ fixed: weights([0, 0]), gain: 2, strength: 0.5 }), 1)).toBe(0.5);
  });

  it("fades along the surface (Eq. 7)", () => {
    const local = column({ layer: layer([0, 0], 2, [0, 0.5]), exponent: 2 });
    expect(weightOf(local, 0)).toBeCloseTo(1, 4);
    expect(weightOf(local, 1)).toBeCloseTo(0.25, 4);
  });

  it("is shared among counterparts, and taken as it is where it is a weight", () => {
    expect(weightOf(column({ share: weights([0.5]) }), 0)).toBeCloseTo(0.5, 4);
    expect(weightOf(column({ share: weights([0.5]), shareGain: 4 }), 0)).toBe(1);
    expect(weightOf(column({ layer: weights([0.3]), reach: 0.1 }), 0)).toBeCloseTo(0.3, 4);
  });
});

describe("falloff", () => {
  it.each(Object.keys(CURVES) as Falloff[])("%s goes from 0 to 1 and never down", (kind) => {
    const values = Array.from({ length: 101 }, (_, i) => CURVES[kind](i / 100));
    expect(values[0]).toBe(0);
    expect(values[100]).toBe(1);
    values.slice(1).forEach((value, i) => expect(value).toBeGreaterThanOrEqual(values[i]));
  });
});

describe("posePoint", () => {
  const point: Vec3 = [1, 2, 3];

  it("leaves everything in place while all rests", () => {
    expect(posePoint(scene([column({}), column({})]), point, 0).position).toEqual(point);
  });

  it("moves by the weight, and adds up", () => {
    expect(posePoint(scene([column({ transform: up })]), point, 1).position[1]).toBeCloseTo(2.75, 4);
    const both = scene([column({ transform: up }), column({ transform: up })]);
    expect(posePoint(both, point, 1).position[1]).toBeCloseTo(3.5, 4);
  });

  it("gives D₀ what the weights leave of 1 (Eq. 1)", () => {
    const down = scene([column({})], { defaultTransform: matrixOf({ ...REST, translation: [0, -1, 0] }, [0, 0, 0]) });
    expect(posePoint(down, point, 0).position[1]).toBeCloseTo(2, 4);
    expect(posePoint(down, point, 1).position[1]).toBeCloseTo(1.75, 4);
    expect(posePoint(down, point, 2).position[1]).toBeCloseTo(1, 4);
  });

  it("mirrors on the other side of the plane (Eq. 8), smoothly within the band", () => {
    const mirror = { normal: [1, 0, 0] as Vec3, offset: 0, band: 0.5 };
    const right = column({ layer: weights([1]), transform: matrixOf({ ...REST, translation: [1, 0, 0] }, [0, 0, 0]) });
    const x = (at: number) => posePoint(scene([right], { mirror }), [at, 0, 0], 0).position[0];
    expect(x(2)).toBeCloseTo(3, 6);
    expect(x(-2)).toBeCloseTo(-3, 6);
    expect(x(0)).toBeCloseTo(0, 6);
    expect(x(0.25)).toBeCloseTo(0.25 + (2 * 0.84375 - 1), 6);
  });

  it("says how warm a point is", () => {
    expect(posePoint(scene([column({ heat: 1 })]), point, 1).heat).toBeCloseTo(0.75, 4);
    expect(posePoint(scene([column({})]), point, 1).heat).toBe(0);
  });
});

describe("transforms of places", () => {
  it("act relative to a center", () => {
    const turn = matrixOf({ ...REST, rotation: [0, 0, 90] }, [10, 0, 0]);
    const moved = apply(relative(turn, [10, 0, 0]), [1, 0, 0]);
    [0, 1, 0].forEach((x, i) => expect(moved[i]).toBeCloseTo(x, 10));
  });

  it("mirror a motion as the mirrored point moves", () => {
    const mirror = { normal: [0, 0, 1] as Vec3, offset: 1, band: 0 };
    const turn = matrixOf({ ...REST, rotation: [20, 30, 40], translation: [1, 2, 3] }, [1, 1, 1]);
    const flip = (p: Vec3): Vec3 => [p[0], p[1], 2 - p[2]];
    const [a, b] = [apply(mirrored(turn, mirror), [0.3, 0.7, 2]), flip(apply(turn, flip([0.3, 0.7, 2])))];
    a.forEach((x, i) => expect(x).toBeCloseTo(b[i], 10));
  });

  it("do at a counterpart, in its frame, what they do at the handle", () => {
    const frame: Frame = [
      [-1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ];
    const counterpart = { position: [-2, 0, 0] as Vec3, gain: 1, share: weights([1]), frame };
    const turn = matrixOf({ ...REST, rotation: [0, 0, 90], translation: [1, 0, 0] }, [1, 0, 0]);
    const other = counterpartMatrix(turn, [1, 0, 0], counterpart, [-1, 0, 0]);
    // The pivot's translation, mirrored, and the turn the other way round.
    [-2, 0, 0].forEach((x, i) => expect(apply(other, [-1, 0, 0])[i]).toBeCloseTo(x, 10));
    [-2, 1, 0].forEach((x, i) => expect(apply(other, [-2, 0, 0])[i]).toBeCloseTo(x, 10));
    expect(counterpartPivot(REST, [2, 0, 0], counterpart)).toEqual([-2, 0, 0]);
    expect(counterpartPivot({ ...REST, pivot: [3, 1, 0] }, [2, 0, 0], counterpart)).toEqual([-3, 1, 0]);
  });
});

describe("sameScene", () => {
  const mirror = { normal: [1, 0, 0], offset: 0, band: 0 } as const;
  const one = scene([column({})], { defaultTransform: IDENTITY, mirror });

  it("compares numbers, not the objects that hold them", () => {
    const columns = [{ ...one.columns[0], transform: IDENTITY.clone() }];
    const copy = { columns, defaultTransform: IDENTITY.clone(), mirror: { ...mirror, normal: [1, 0, 0] as const } };
    expect(sameScene(one, copy)).toBe(true);
  });

  it.each<[string, Scene]>([
    ["columns", EMPTY_SCENE],
    ["reach", scene([{ ...one.columns[0], reach: 0.9 }], { defaultTransform: IDENTITY, mirror })],
    ["layer", scene([column({ layer: layer([0]) })], { defaultTransform: IDENTITY, mirror })],
    ["transform", scene([{ ...one.columns[0], transform: up }], { defaultTransform: IDENTITY, mirror })],
    ["D₀", { ...one, defaultTransform: null }],
    ["mirror", { ...one, mirror: { ...mirror, normal: [0, 1, 0] } }],
    ["band", { ...one, mirror: { ...mirror, band: 1 } }],
  ])("sees another %s", (_, other) => expect(sameScene(one, other)).toBe(false));
});
