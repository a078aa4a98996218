import { change, moveTo, setAxes, slide } from "../actions/edit";
import type { HandleState } from "../protocol/messages";
import { present, store } from "../store/state";
import { useStore } from "../store/use";
import type { Transform, Vec3 } from "../viewer/affine";
import { isFalloff } from "../viewer/columns";
import { heldPart } from "../viewer/measure";
import { niceStep } from "../viewer/viewer";
import { IconButton, NumberField, Select, Slider, Toggle } from "./controls";

const AXES = ["x", "y", "z"] as const;

export function HandlePanel({ known }: { readonly known: HandleState }) {
  const state = useStore(store, (all) => all);
  const handle = present(state, known);
  const { transform } = handle;
  const step = niceStep((state.mesh?.diagonal ?? 1) / 100);
  const set = (part: Partial<Transform>) => moveTo(handle.handle, { ...transform, ...part });
  const column = state.columns.get(handle.column);
  const kind = isFalloff(handle.falloff) ? handle.falloff : "linear";
  const held = column ? heldPart(column.layer, handle.reach, kind) : 0;
  const offers = (name: string) => state.edit?.controls.includes(name) ?? false;
  return (
    <>
      <Triple label="Move" value={transform.translation} step={step} onChange={(translation) => set({ translation })} />
      <Triple label="Rotate °" value={transform.rotation} step={1} onChange={(rotation) => set({ rotation })} />
      <Scale value={transform.scale} onChange={(scale) => set({ scale })} />
      <Toggle
        label="Scale along the surface"
        checked={transform.axes !== null}
        onChange={(on) => setAxes(handle.handle, on ? "normal" : "auto")}
      />
      <Triple
        label="Pivot"
        value={transform.pivot ?? handle.position}
        step={step}
        onChange={(pivot) => set({ pivot })}
        action={
          <IconButton
            icon="reset"
            label="Return the pivot to the handle"
            disabled={transform.pivot === null}
            onPress={() => set({ pivot: null })}
          />
        }
      />
      {handle.kind === "distance" && (
        <>
          <Slider
            label="Reach"
            hint="How unlike the handle something may look and still follow; also the wheel while dragging, or [ and ]"
            value={handle.reach}
            min={0.05}
            max={1.5}
            step={0.01}
            disabled={!offers("reach")}
            text={`${handle.reach.toFixed(2)} · holds ${Math.round(100 * held)} %`}
            onInput={(reach) => slide(handle.handle, { reach })}
          />
          {offers("falloff") && (state.edit?.falloffs.length ?? 0) > 1 && (
            <Select
              label="Falloff"
              value={handle.falloff}
              options={state.edit?.falloffs ?? []}
              onChange={(falloff) => change(handle.handle, { falloff })}
            />
          )}
        </>
      )}
      <Slider
        label="Locality"
        hint="0 reaches all that looks alike; more stays near the handle along the surface"
        value={handle.locality}
        min={0}
        max={20}
        step={0.5}
        text={handle.locality === 0 ? "everywhere" : handle.locality.toFixed(1)}
        onInput={(locality) => slide(handle.handle, { locality })}
      />
      {offers("strength") && (
        <Slider
          label="Strength"
          value={handle.strength}
          min={0}
          max={1}
          step={0.05}
          text={`${Math.round(100 * handle.strength)} %`}
          onInput={(strength) => change(handle.handle, { strength })}
        />
      )}
      {offers("instances") && (state.edit?.instances.length ?? 0) > 1 && (
        <Select
          label="Look-alikes"
          hint="How the handle's look-alikes move: each about its own pivot, together, or not at all"
          value={handle.instances}
          options={state.edit?.instances ?? []}
          onChange={(instances) => change(handle.handle, { instances })}
        />
      )}
      {column && column.instances.length > 1 && (
        <div class="instances" role="group" aria-label="Look-alikes">
          <Toggle
            label="Show where it acts"
            checked={state.showGhosts}
            onChange={(showGhosts) => store.set({ showGhosts })}
          />
        </div>
      )}
    </>
  );
}

interface TripleProps {
  readonly label: string;
  readonly value: Vec3;
  readonly step: number;
  readonly onChange: (value: Vec3) => void;
  readonly action?: preact.ComponentChildren;
}

function Triple({ label, value, step, onChange, action }: TripleProps) {
  return (
    <div class="triple" role="group" aria-label={label}>
      <span class="triple-label">
        {label}
        {action}
      </span>
      {AXES.map((axis, i) => (
        <NumberField
          key={axis}
          axis={axis}
          label={`${label} ${axis}`}
          value={value[i]}
          step={step}
          onChange={(number) => onChange(value.map((other, j) => (j === i ? number : other)) as unknown as Vec3)}
        />
      ))}
    </div>
  );
}

/** One factor for all axes where they are alike, and a switch to have three. */
function Scale({ value, onChange }: { readonly value: Vec3; readonly onChange: (value: Vec3) => void }) {
  const uniform = useStore(store, (state) => state.uniformScale);
  return (
    <div class="triple" role="group" aria-label="Scale">
      <span class="triple-label">
        Scale
        <IconButton
          icon="link"
          label="Scale all axes alike"
          pressed={uniform}
          onPress={() => store.set({ uniformScale: !uniform })}
        />
      </span>
      {AXES.map((axis, i) => (
        <NumberField
          key={axis}
          axis={axis}
          label={`Scale ${axis}`}
          value={value[i]}
          step={0.05}
          onChange={(factor) => {
            if (factor === 0) return;
            onChange(
              value.map((other, j) =>
                j === i ? factor : uniform ? (other * factor) / value[i] : other,
              ) as unknown as Vec3,
            );
          }}
        />
      ))}
    </div>
  );
}
