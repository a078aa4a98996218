/** The panels on the right: handles, fixed points and settings. */

import { send } from "../actions/connection";
import { throttle } from "../actions/edit";
import { niceStep, REST, type Transform } from "../posing/affine";
import type { FixedState, StateMessage } from "../protocol/messages";
import { placeName, ready, selectedHandle, store } from "../store/state";
import { useParts } from "../store/use";
import { Button, count, IconButton, Panel, percent, PlaceRow, Select, Slider, titled } from "../widgets/controls";
import { HandleList } from "./handle_list";
import { HandlePanel, motionFields } from "./handle_panel";
import { MarkPanel } from "./mark_panel";
import { SymmetryPanel } from "./symmetry_panel";

export function Inspector() {
  const state = useParts();
  const { inspector, edit } = state;
  const handle = selectedHandle(state);
  if (!inspector) return null;
  return (
    <aside class="inspector" aria-label="Inspector">
      <HandleList />
      {edit && state.tool === "marks" && <MarkPanel known={edit} />}
      {handle && <HandlePanel known={handle} />}
      {edit && edit.fixed.length > 0 && <FixedPanel fixed={edit.fixed} />}
      {edit && ready(state) && <SymmetryPanel known={edit} />}
      {edit && <ShapePanel known={edit} />}
      {edit && state.more && ready(state) && <DefaultPanel known={edit} />}
    </aside>
  );
}

function FixedPanel({ fixed }: { readonly fixed: readonly FixedState[] }) {
  return (
    <Panel title="Fixed">
      <ul class="rows">
        {fixed.map((place, index) => {
          const name = titled(placeName(place));
          const release = () => send({ type: "release", index });
          return (
            <PlaceRow key={`${name} ${index}`} dot="fixed" name={name} verb="Release" onRemove={release}>
              <Slider
                label="Strength"
                of={` of ${name}`}
                hint="How strongly this point and similar parts stay in place"
                value={place.strength}
                range={[0, 1, 0.05]}
                text={percent(place.strength)}
                onChange={(strength) =>
                  throttle(`fixed ${index}`, (merge) => send({ type: "change_fixed", index, strength, merge }))
                }
              />
            </PlaceRow>
          );
        })}
      </ul>
    </Panel>
  );
}

/** The default transform D₀ of Eq. 1. It moves all surface that follows no handle. */
function DefaultPanel({ known }: { readonly known: StateMessage }) {
  const size = useParts().mesh?.diagonal ?? 1;
  const now = { ...REST, ...known.default };
  const set = (part: Partial<Transform>) => {
    const { translation, rotation, scale } = { ...now, ...part };
    throttle("default", (merge) => send({ type: "set_default", transform: { translation, rotation, scale }, merge }));
  };
  const reset = <IconButton icon="reset" label="Reset" disabled={known.default === null} onClick={() => set(REST)} />;
  return (
    <Panel title="The rest of the shape" action={reset}>
      {Object.values(motionFields(now, niceStep(size / 100), set, " the rest"))}
    </Panel>
  );
}

function ShapePanel({ known }: { readonly known: StateMessage }) {
  const { mesh, report, session } = useParts();
  const { status, origin } = known.field;
  const features = status === "ready" ? (origin ?? "ready") : status === "none" ? "not learned yet" : `${status}…`;
  const preset = session?.controls.find(({ name }) => name === "preset");
  return (
    <Panel title="Shape">
      {status === "ready" && preset && (
        <Select
          label={preset.label}
          hint={preset.hint}
          value={known.preset}
          options={preset.choices as StateMessage["preset"][]}
          onChange={(choice) => send({ type: "set_preset", preset: choice })}
        />
      )}
      {mesh && (
        <dl class="facts">
          {Object.entries({ Faces: mesh.faces, Vertices: mesh.vertices, "Scene parts": Math.max(mesh.parts, 1) }).map(
            ([name, number]) => [<dt key={name}>{name}</dt>, <dd key={`${name}:`}>{count.format(number)}</dd>],
          )}
          <dt>Features</dt>
          <dd>{features}</dd>
        </dl>
      )}
      {report && report.details.length > 0 && (
        <details class="report">
          <summary>What the edit did</summary>
          {report.details.map((line) => (
            <p key={line}>{line}</p>
          ))}
          <Button text="Too much, or too little?" kind="small" onClick={() => store.set({ help: true })} />
        </details>
      )}
    </Panel>
  );
}
