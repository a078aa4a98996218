import { send } from "../actions/connection";
import { throttle } from "../actions/edit";
import type { StateMessage, SymmetryPlane } from "../protocol/messages";
import { useParts } from "../store/use";
import { Panel, percent, Segmented, Slider } from "../widgets/controls";

const AXES = ["x", "y", "z"] as const;
type Axis = (typeof AXES)[number];

export function SymmetryPanel({ known: { symmetry: used, planes: found } }: { readonly known: StateMessage }) {
  const { mesh } = useParts();
  const size = mesh?.diagonal ?? 1;
  const planes = new Map<string, SymmetryPlane | Axis | null>([["None", null]]);
  // The order is the same for every shape.
  for (const axis of AXES) {
    planes.set(axis.toUpperCase(), found.find((plane) => axisOf(plane) === axis.toUpperCase()) ?? axis);
  }
  const slanted = found.filter((plane) => axisOf(plane) === undefined);
  slanted.forEach((plane, i) => planes.set(`Slanted ${i + 1}`, plane));
  const shown = used && ([...planes].find(([, plane]) => same(plane, used))?.[0] ?? axisOf(used) ?? "Other");
  if (used && shown && !planes.has(shown)) planes.set(shown, used);
  return (
    <Panel title="Symmetry">
      <Segmented
        label="Mirror plane"
        hint="Mirror each handle across this plane"
        value={shown ?? "None"}
        options={[...planes.keys()]}
        onChange={(name) => send({ type: "set_symmetry", plane: planes.get(name) ?? null })}
      />
      {used && (
        <Slider
          label="Blend width"
          hint="The two sides blend within this distance of the plane. At 0, the cut is sharp."
          value={(used.band ?? 0) / size}
          range={[0, 0.1, 0.0025]}
          text={used.band ? `${percent(used.band / size)} of the size` : "sharp"}
          onChange={(part) =>
            throttle("band", (merge) => send({ type: "set_symmetry", plane: used, band: part * size, merge }))
          }
        />
      )}
    </Panel>
  );
}

/** Return the coordinate axis that is perpendicular to a plane, if there is one. */
function axisOf({ normal }: SymmetryPlane): string | undefined {
  return AXES.find((_, i) => Math.abs(normal[i]) > 0.999)?.toUpperCase();
}

function same(a: SymmetryPlane | Axis | null, b: SymmetryPlane): boolean {
  if (a === null || typeof a === "string") return false;
  const dot = a.normal.reduce((sum, entry, i) => sum + entry * b.normal[i], 0);
  return Math.abs(dot) > 0.9999 && Math.abs(a.offset - Math.sign(dot) * b.offset) < 1e-6 * (1 + Math.abs(a.offset));
}
