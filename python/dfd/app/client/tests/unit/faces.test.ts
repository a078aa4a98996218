import { describe, expect, it } from "vitest";

import { Faces } from "../../src/viewer/posing/faces";

// Two triangles of a square in z = 0, and one above them. All three have the same last corner.
const positions = Float32Array.of(0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 0, 0, 1);
const faces = new Faces(positions, Uint32Array.of(0, 1, 2, 3, 0, 2, 4, 0, 2));

describe("Faces", () => {
  it("finds the triangle and its nearest corner", () => {
    expect(faces.nearestRow([0.9, 0.2, 0], 2)).toBe(1);
    expect(faces.nearestRow([0.1, 0.8, 0], 2)).toBe(3);
    expect(faces.nearestRow([0.1, 0.1, 0.8], 2)).toBe(4);
  });

  it("returns null for a row that is the last corner of no triangle", () => {
    expect(faces.nearestRow([0, 0, 0], 4)).toBeNull();
  });
});
