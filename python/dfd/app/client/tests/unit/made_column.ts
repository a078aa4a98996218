import { IDENTITY } from "../../src/posing/affine";
import type { Column } from "../../src/posing/columns";

/** Return a column with these weights and the identity as its transform; `part` replaces other values. */
export function madeColumn(weights: readonly number[], part: Partial<Column> = {}): Column {
  const quantized = Uint16Array.from(weights, (weight) => Math.round(weight * 65535));
  return { handle: 1, weights: quantized, positive: true, heat: 0, transform: IDENTITY, ...part };
}
