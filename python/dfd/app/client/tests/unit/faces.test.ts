import { describe, expect, it } from "vitest";

import { Faces } from "../../src/viewer/posing/faces";

// Two triangles of a square in z = 0, and one above them that shares the last corner.
const positions = Float32Array.of(0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 0, 0, 1);
const faces = new Faces(positions, Uint32Array.of(0, 1, 2, 3, 0, 2, 4, 0, 2));

describe("Faces", () => {
  it("finds the triangle and its nearest corner", () => {
    expect(faces.find([0.9, 0.2, 0], 2)).toMatchObject({ face: 0, row: 1 });
    expect(faces.find([0.1, 0.8, 0], 2)).toMatchObject({ face: 1, row: 3 });
    expect(faces.find([0.1, 0.1, 0.8], 2)).toMatchObject({ face: 2, row: 4 });
  });

  it("finds none at a corner that is nobody's last", () => {
    expect(faces.find([0, 0, 0], 4)).toBeNull();
  });
});
