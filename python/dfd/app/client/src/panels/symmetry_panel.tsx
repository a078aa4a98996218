import { setBand, setSymmetry } from "../actions/edit";
import type { Plane, StateMessage } from "../protocol/messages";
import { store } from "../store/state";
import { useStore } from "../store/use";
import { Panel, readable, Slider, Toggle } from "../widgets/controls";

export function SymmetryPanel({ known }: { readonly known: StateMessage }) {
  const shown = useStore(store, (state) => state.showPlanes);
  const size = useStore(store, (state) => state.mesh?.diagonal ?? 1);
  const used = known.symmetry;
  const found = known.planes;
  const others = (["x", "y", "z"] as const).filter((axis) => !found.some((plane) => isAcross(plane, axis)));
  const foreign = used && !found.some((plane) => same(plane, used)) && !others.some((axis) => isAcross(used, axis));
  return (
    <Panel title="Symmetry">
      <div class="chips" role="group" aria-label="Mirror plane">
        <button type="button" class="chip" aria-pressed={!used} onClick={() => setSymmetry(null)}>
          None
        </button>
        {found.map((plane, i) => (
          <button
            key={i}
            type="button"
            class="chip found"
            aria-pressed={used !== null && same(plane, used)}
            title={
              plane.score === undefined || plane.score === null
                ? "Found"
                : `Found: its sides differ by ${plane.score.toFixed(3)}`
            }
            onClick={() => setSymmetry(plane)}
          >
            {nameOf(plane)}
          </button>
        ))}
        {others.map((axis) => (
          <button
            key={axis}
            type="button"
            class="chip"
            aria-pressed={used !== null && isAcross(used, axis)}
            title={`Across ${axis}, through the middle of the box`}
            onClick={() => setSymmetry(axis)}
          >
            {axis.toUpperCase()}
          </button>
        ))}
        {foreign && (
          <button type="button" class="chip" aria-pressed={true}>
            {nameOf(used)}
          </button>
        )}
      </div>
      {used && (
        <Slider
          label="Blend width"
          hint="How far from the plane the two sides pass into each other; 0 is a sharp cut"
          value={(used.band ?? 0) / size}
          min={0}
          max={0.1}
          step={0.0025}
          text={used.band ? `${readable(used.band)} · ${((100 * used.band) / size).toFixed(1)} %` : "sharp"}
          onInput={(part) => setBand(used, part * size)}
        />
      )}
      {found.length > 0 && (
        <Toggle label="Show what was found" checked={shown} onChange={(showPlanes) => store.set({ showPlanes })} />
      )}
    </Panel>
  );
}

function isAcross(plane: Plane, axis: "x" | "y" | "z"): boolean {
  return Math.abs(plane.normal[{ x: 0, y: 1, z: 2 }[axis]]) > 0.999;
}

function nameOf(plane: Plane): string {
  const axis = (["x", "y", "z"] as const).find((name) => isAcross(plane, name));
  return axis ? axis.toUpperCase() : (plane.name ?? "Slanted");
}

function same(a: Plane, b: Plane): boolean {
  const dot = a.normal.reduce((sum, entry, i) => sum + entry * b.normal[i], 0);
  return Math.abs(dot) > 0.9999 && Math.abs(a.offset - Math.sign(dot) * b.offset) < 1e-6 * (1 + Math.abs(a.offset));
}
