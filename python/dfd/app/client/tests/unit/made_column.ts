import { IDENTITY } from "../../src/posing/affine";
import type { Column, Layer } from "../../src/posing/columns";

/** A handle's column that changes nothing of what its layer says, but for `part`. */
export function madeColumn(layer: Layer, part: Partial<Column> = {}): Column {
  return {
    handle: 1,
    layer,
    fixed: null,
    share: null,
    shareGain: 1,
    reach: 1,
    falloff: "linear",
    exponent: 0,
    gain: 1,
    strength: 1,
    positive: true,
    heat: 0,
    transform: IDENTITY,
    acts: true,
    ...part,
  };
}
