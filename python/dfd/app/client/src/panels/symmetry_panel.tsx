import { send } from "../actions/connection";
import { throttle } from "../actions/edit";
import type { Plane, StateMessage } from "../protocol/messages";
import { store } from "../store/state";
import { useParts } from "../store/use";
import { Panel, readable, Slider, Toggle } from "../widgets/controls";

const AXES = ["x", "y", "z"] as const;
type Axis = (typeof AXES)[number];

export function SymmetryPanel({ known: { symmetry: used, planes: found } }: { readonly known: StateMessage }) {
  const { showPlanes, mesh } = useParts();
  const size = mesh?.diagonal ?? 1;
  const others = AXES.filter((axis) => !found.some((plane) => isAcross(plane, axis)));
  const foreign = used && !found.some((plane) => same(plane, used)) && !others.some((axis) => isAcross(used, axis));
  const chip = (text: string, title: string, pressed: boolean, plane: Plane | Axis | null, isFound = false) => (
    <button
      key={`${text} ${title}`}
      type="button"
      class={isFound ? "chip found" : "chip"}
      aria-pressed={pressed}
      title={title}
      onClick={() => send({ type: "set_symmetry", plane })}
    >
      {text}
    </button>
  );
  return (
    <Panel title="Symmetry">
      <div class="chips" role="group" aria-label="Mirror plane">
        {chip("None", "", !used, null)}
        {found.map((plane) => {
          const title = plane.score ? `Found: its sides differ by ${plane.score.toFixed(3)}` : "Found";
          return chip(nameOf(plane), title, used !== null && same(plane, used), plane, true);
        })}
        {others.map((axis) => {
          const title = `Across ${axis}, through the middle of the box`;
          return chip(axis.toUpperCase(), title, used !== null && isAcross(used, axis), axis);
        })}
        {foreign && chip(nameOf(used), "", true, used)}
      </div>
      {used && (
        <Slider
          label="Blend width"
          hint="How far from the plane the two sides pass into each other; 0 is a sharp cut"
          value={(used.band ?? 0) / size}
          range={[0, 0.1, 0.0025]}
          text={used.band ? `${readable(used.band)} · ${((100 * used.band) / size).toFixed(1)} %` : "sharp"}
          onInput={(part) =>
            throttle("band", (merge) => send({ type: "set_symmetry", plane: used, band: part * size, merge }))
          }
        />
      )}
      {found.length > 0 && (
        <Toggle label="Show what was found" checked={showPlanes} onChange={(on) => store.set({ showPlanes: on })} />
      )}
    </Panel>
  );
}

function isAcross(plane: Plane, axis: Axis): boolean {
  return Math.abs(plane.normal[AXES.indexOf(axis)]) > 0.999;
}

function nameOf(plane: Plane): string {
  return AXES.find((axis) => isAcross(plane, axis))?.toUpperCase() ?? plane.name ?? "Slanted";
}

function same(a: Plane, b: Plane): boolean {
  const dot = a.normal.reduce((sum, entry, i) => sum + entry * b.normal[i], 0);
  return Math.abs(dot) > 0.9999 && Math.abs(a.offset - Math.sign(dot) * b.offset) < 1e-6 * (1 + Math.abs(a.offset));
}
