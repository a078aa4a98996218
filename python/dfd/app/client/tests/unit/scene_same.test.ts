import { describe, expect, it } from "vitest";

import { IDENTITY, matrixOf, REST } from "../../src/posing/affine";
import { EMPTY_SCENE, sameScene, type Scene } from "../../src/posing/columns";
import { madeColumn } from "./made_column";

const layer = { values: Uint16Array.of(1, 2), scale: 2, kind: "distance", geodesic: null } as const;
const column = madeColumn(layer);
const mirror = { normal: [1, 0, 0], offset: 0, band: 0 } as const;
const scene: Scene = { columns: [column], defaultTransform: IDENTITY, mirror };

describe("sameScene", () => {
  it("compares numbers, not the arrays that hold them", () => {
    const copy = {
      columns: [{ ...column, transform: [...IDENTITY] }],
      defaultTransform: [...IDENTITY],
      mirror: { ...mirror, normal: [1, 0, 0] as const },
    };
    expect(sameScene(scene, copy)).toBe(true);
  });

  it("sees whatever changes the picture", () => {
    const moved = matrixOf({ ...REST, translation: [0, 0, 1e-9] }, [0, 0, 0]);
    for (const changed of [
      EMPTY_SCENE,
      { ...scene, columns: [{ ...column, reach: 0.9 }] },
      { ...scene, columns: [{ ...column, heat: 1 }] },
      { ...scene, columns: [{ ...column, layer: { ...layer } }] },
      { ...scene, columns: [{ ...column, transform: moved }] },
      { ...scene, columns: [column, column] },
      { ...scene, defaultTransform: null },
      { ...scene, mirror: null },
      { ...scene, mirror: { ...mirror, band: 0.1 } },
    ]) {
      expect(sameScene(scene, changed)).toBe(false);
      expect(sameScene(changed, scene)).toBe(false);
    }
  });
});
