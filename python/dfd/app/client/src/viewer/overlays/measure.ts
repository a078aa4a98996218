/** How much of the shape a handle holds, from a histogram of its distances: fast enough for every turn of the wheel. */

import { falloff, type Falloff, type Layer } from "../posing/columns";

const BINS = 512;
const histograms = new WeakMap<Layer, Float64Array>();

/** Part of the vertices whose weight, before fixed places and locality, is above `least`. */
export function heldPart(layer: Layer, reach: number, kind: Falloff, least = 0.05): number {
  let counts = histograms.get(layer);
  if (!counts) {
    counts = new Float64Array(BINS);
    for (const value of layer.values) counts[(value * BINS) >> 16]++;
    histograms.set(layer, counts);
  }
  let held = 0;
  counts.forEach((count, bin) => {
    const value = ((bin + 0.5) / BINS) * layer.scale;
    const weight = layer.kind === "weight" ? value : falloff(Math.max(1 - value / reach, 0), kind);
    if (weight > least) held += count;
  });
  return held / Math.max(layer.values.length, 1);
}
