import { IDENTITY } from "../../src/posing/affine";
import type { Column } from "../../src/posing/columns";

/** A column with these weights of a handle that rests, but for `part`. */
export function madeColumn(weights: readonly number[], part: Partial<Column> = {}): Column {
  const quantized = Uint16Array.from(weights, (weight) => Math.round(weight * 65535));
  return { handle: 1, weights: quantized, positive: true, heat: 0, transform: IDENTITY, ...part };
}
