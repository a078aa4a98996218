import { describe, expect, it } from "vitest";

import { followed, heldPart, surfaceOf } from "../../src/posing/held";
import { madeColumn } from "./made_column";

// Two separate triangles. The second has nine times the area of the first, and its last corner has two rows.
const POSITIONS = Float32Array.from([0, 0, 0, 1, 0, 0, 0, 1, 0, 5, 0, 0, 8, 0, 0, 5, 3, 0, 5, 3, 0]);
const surface = surfaceOf(6, POSITIONS, Uint32Array.from([0, 1, 2, 3, 4, 6]), Uint32Array.from([0, 1, 2, 3, 4, 5, 5]));
const SMALL = [1, 1, 1, 0, 0, 0];

describe("heldPart", () => {
  it("is a share of the area, not of the number of vertices", () => {
    expect(surface.areas.reduce((sum, area) => sum + area)).toBeCloseTo(15);
    expect(heldPart([madeColumn(SMALL)], surface)).toBeCloseTo(0.1);
    expect(heldPart([madeColumn([0, 0, 0, 0.3, 0.3, 0.01])], surface)).toBeCloseTo(0.6);
  });

  it("includes the columns of counterparts", () => {
    const [own, like] = [madeColumn(SMALL), madeColumn([0, 0, 0, 0.5, 0.5, 0.5])];
    expect(heldPart([own, like], surface)).toBeCloseTo(1);
    expect(heldPart([own], surface)).toBeCloseTo(0.1);
    expect(followed([own, like], 3)).toBeCloseTo(0.5, 4);
    expect(followed([own], 3)).toBe(0);
  });

  it("measures a subset of the vertices if there are many", () => {
    const few = surfaceOf(3, POSITIONS, Uint32Array.from([0, 1, 2]), Uint32Array.from([0, 1, 2]), 2);
    expect(few.vertices).toEqual(Uint32Array.from([0, 2]));
    expect(heldPart([madeColumn(SMALL.with(1, 0).with(2, 0))], few)).toBeCloseTo(0.5);
  });
});
