import { describe, expect, it } from "vitest";

import { IDENTITY, matrixOf, REST } from "../../src/posing/affine";
import { EMPTY_SCENE, type Column, type Layer } from "../../src/posing/columns";
import { PoseTextures } from "../../src/viewer/posing/pose_textures";
import { madeColumn } from "./made_column";

const layer = (value: number): Layer => ({
  values: Uint16Array.of(value, value + 1),
  scale: 2,
  kind: "distance",
  geodesic: null,
});
const column = (own: Layer): Column =>
  madeColumn(own, { transform: matrixOf({ ...REST, translation: [1, 2, 3] }, [0, 0, 0]) });
const stored = (textures: PoseTextures) => textures.distances.image.data as Uint16Array;

describe("PoseTextures", () => {
  it("grows when there are more columns than places, and loses none", () => {
    const textures = new PoseTextures(2);
    const layers = Array.from({ length: 40 }, (_, i) => layer(100 * (i + 1)));
    textures.show({ ...EMPTY_SCENE, columns: layers.slice(0, 3).map(column) });
    textures.show({ ...EMPTY_SCENE, columns: layers.map(column) });
    const places = textures.columns.image.data as Float32Array;
    layers.forEach((own, k) => {
      const place = places[40 * k + 28];
      expect(stored(textures)[2 * 4096 * place]).toBe(own.values[0]);
    });
    expect(textures.columnCount).toBe(40);
  });

  it("writes what a transform adds to a point", () => {
    const textures = new PoseTextures(2);
    textures.show({ ...EMPTY_SCENE, columns: [column(layer(0)), { ...column(layer(0)), transform: IDENTITY }] });
    const table = textures.columns.image.data as Float32Array;
    expect([...table.slice(0, 12)]).toEqual([0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3]);
    expect([...table.slice(40, 52)].every((entry) => entry === 0)).toBe(true);
  });
});
