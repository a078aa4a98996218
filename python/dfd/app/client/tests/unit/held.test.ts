import { describe, expect, it } from "vitest";

import type { Layer } from "../../src/posing/columns";
import { followed, heldPart, surfaceOf } from "../../src/posing/held";
import { madeColumn } from "./made_column";

const quantized = (values: number[], scale = 1) =>
  Uint16Array.from(values, (value) => Math.round((value / scale) * 65535));
const distances = (values: number[], geodesic: number[] | null = null): Layer => ({
  values: quantized(values, 2),
  scale: 2,
  kind: "distance",
  geodesic: geodesic && quantized(geodesic),
});
const weights = (values: number[]): Layer => ({ values: quantized(values), scale: 1, kind: "weight", geodesic: null });

// Two triangles apart, the second of nine times the area; its last corner has two rows.
const POSITIONS = Float32Array.from([0, 0, 0, 1, 0, 0, 0, 1, 0, 5, 0, 0, 8, 0, 0, 5, 3, 0, 5, 3, 0]);
const surface = surfaceOf(6, POSITIONS, Uint32Array.from([0, 1, 2, 3, 4, 6]), Uint32Array.from([0, 1, 2, 3, 4, 5, 5]));
const SMALL = [0, 0, 0, 1.5, 1.5, 1.5];

describe("heldPart", () => {
  it("is of the surface, not of the vertices", () => {
    expect(surface.areas.reduce((sum, area) => sum + area)).toBeCloseTo(30);
    expect(heldPart([madeColumn(distances(SMALL))], surface)).toBeCloseTo(0.1);
    expect(heldPart([madeColumn(distances(SMALL), { reach: 2 })], surface)).toBeCloseTo(1);
  });

  it("follows fixed points, locality, strength and what is sent as weights", () => {
    const fixed = weights([0, 1, 1, 0, 0, 0]);
    expect(heldPart([madeColumn(distances(SMALL), { fixed })], surface)).toBeCloseTo(0.1 / 3);
    const local = distances([0, 0, 0, 0, 0, 0], [0, 0, 0, 1, 1, 1]);
    expect(heldPart([madeColumn(local)], surface)).toBeCloseTo(1);
    expect(heldPart([madeColumn(local, { exponent: 2 })], surface)).toBeCloseTo(0.1);
    expect(heldPart([madeColumn(local, { strength: 0.01 })], surface)).toBe(0);
    expect(heldPart([madeColumn(weights([0, 0, 0, 0.3, 0.3, 0.01]))], surface)).toBeCloseTo(0.6);
  });

  it("adds the counterparts that follow, and says of one that it does not", () => {
    const [own, like] = [
      { share: weights([1, 1, 1, 0, 0, 0]), shareGain: 1 },
      { share: weights([0, 0, 0, 1, 1, 1]), shareGain: 1 },
    ].map((part) => madeColumn(distances([0, 0, 0, 0.5, 0.5, 0.5]), part));
    expect(heldPart([own, like], surface)).toBeCloseTo(1);
    expect(heldPart([own], surface)).toBeCloseTo(0.1);
    expect(followed([own, like], 3)).toBeCloseTo(0.5, 4);
    expect(followed([own], 3)).toBe(0);
  });

  it("measures a part of many vertices", () => {
    const few = surfaceOf(3, POSITIONS, Uint32Array.from([0, 1, 2]), Uint32Array.from([0, 1, 2]), 2);
    expect(few.vertices).toEqual(Uint32Array.from([0, 2]));
    expect(heldPart([madeColumn(distances([0, 2, 2, 0, 0, 0]))], few)).toBeCloseTo(0.5);
  });
});
