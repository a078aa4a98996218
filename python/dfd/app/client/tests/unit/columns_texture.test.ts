import { describe, expect, it } from "vitest";

import { matrixOf, REST } from "../../src/posing/affine";
import { EMPTY_SCENE } from "../../src/posing/columns";
import { PoseTextures } from "../../src/viewer/posing/pose_textures";
import { madeColumn } from "./made_column";

const transform = matrixOf({ ...REST, translation: [1, 2, 3] }, [0, 0, 0]);
const stored = (textures: PoseTextures) => textures.weights.image.data as Uint16Array;

describe("PoseTextures", () => {
  it("grows when there are more columns than layers, and keeps all columns", () => {
    const textures = new PoseTextures(2);
    const columns = Array.from({ length: 40 }, (_, i) => madeColumn([(i + 1) / 64], { transform }));
    textures.show({ ...EMPTY_SCENE, columns: columns.slice(0, 3) });
    textures.show({ ...EMPTY_SCENE, columns });
    const table = textures.columns.image.data as Float32Array;
    columns.forEach(({ weights }, k) => expect(stored(textures)[4096 * table[28 * k + 24]]).toBe(weights[0]));
  });

  it("writes the displacement of a transform", () => {
    const textures = new PoseTextures(2);
    textures.show({ ...EMPTY_SCENE, columns: [madeColumn([0], { transform }), madeColumn([0])] });
    const table = textures.columns.image.data as Float32Array;
    expect([...table.slice(0, 12)]).toEqual([0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3]);
    expect([...table.slice(28, 40)].every((entry) => entry === 0)).toBe(true);
  });
});
