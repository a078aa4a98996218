import { othersOf, switchLookAlike } from "../../actions/alike";
import { change, limitTo, moveTo, setAxes, slide, softenLimit } from "../../actions/edit";
import type { HandleState } from "../../protocol/messages";
import { present, selectedHandle, store } from "../../store/state";
import { useStore } from "../../store/use";
import type { Transform } from "../../viewer/posing/affine";
import { isFalloff } from "../../viewer/posing/columns";
import { drawsInSoftware } from "../../viewer/posing/graphics";
import { heldPart } from "../../viewer/overlays/measure";
import { niceStep } from "../../viewer/viewer";
import { IconButton, readable, Select, Slider, Toggle } from "../../widgets/controls";
import { Scale, Triple } from "../../widgets/triple";

/** Milliseconds between numbers. */
const readably = () => (store.get().dragging ? (drawsInSoftware() ? 1000 : 100) : 0);
const count = new Intl.NumberFormat("en");

export function HandlePanel({ known }: { readonly known: HandleState }) {
  // Numbers that change with every frame of a drag are read no faster, and painting them costs more than the frame.
  const state = useStore(store, (all) => all, readably);
  const handle = present(state, known);
  const { transform } = handle;
  const size = state.mesh?.diagonal ?? 1;
  const step = niceStep(size / 100);
  const set = (part: Partial<Transform>) => {
    // What is shown may be older than what was set last.
    const now = selectedHandle(store.get()) ?? known;
    moveTo(now.handle, { ...present(store.get(), now).transform, ...part });
  };
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
      <Slider
        label="Locality"
        hint="0 reaches all that looks alike; more stays near the handle along the surface"
        value={handle.locality}
        min={0}
        max={20}
        step={0.5}
        text={handle.radius !== null ? "by radius" : handle.locality === 0 ? "everywhere" : handle.locality.toFixed(1)}
        onInput={(locality) => slide(handle.handle, { locality })}
      />
      {offers("radius") && (
        <Slider
          label="Radius"
          hint="How far along the surface the handle acts, in parts of the shape's size; the other way to say locality"
          value={handle.radius === null ? 0 : handle.radius / size}
          min={0}
          max={1}
          step={0.01}
          text={
            handle.radius === null
              ? "no limit"
              : `${readable(handle.radius)} · ${Math.round((100 * handle.radius) / size)} %`
          }
          onInput={(part) => slide(handle.handle, part > 0 ? { radius: part * size } : { locality: 0 })}
        />
      )}
      {offers("strength") && (
        <Slider
          label="Strength"
          value={handle.strength}
          min={0}
          max={1}
          step={0.05}
          text={`${Math.round(100 * handle.strength)} %`}
          onInput={(strength) => slide(handle.handle, { strength })}
        />
      )}
      {offers("within") && <Limit handle={handle} />}
      {offers("within_width") && handle.within > 0 && (
        <Slider
          label="Limit's edge"
          hint="How far beyond the limit the handle fades, in parts of the shape's size; 0 cuts it off"
          value={handle.within_width / size}
          min={0}
          max={0.3}
          step={0.005}
          text={handle.within_width === 0 ? "sharp" : `${readable(handle.within_width)} wide`}
          onInput={(part) => softenLimit(handle.handle, part * size)}
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
      {offers("level") && handle.instances !== "only" && (
        <Toggle
          label="Look-alikes follow in full"
          checked={handle.level}
          onChange={(level) => change(handle.handle, { level })}
        />
      )}
      <LookAlikes handle={handle.handle} />
    </>
  );
}

/** Beyond what nothing follows: painted, and taken away again. */
function Limit({ handle }: { readonly handle: HandleState }) {
  const { within } = handle;
  return (
    <div class="limit">
      <span>Limit</span>
      <span class="limit-text">{within > 0 ? `${count.format(within)} vertices` : "none"}</span>
      {within > 0 ? (
        <button type="button" class="button small" onClick={() => limitTo(handle.handle, null)}>
          Remove
        </button>
      ) : (
        <button
          type="button"
          class="button small"
          title="Paint where the handle may act"
          onClick={() => store.set({ tool: "paint" })}
        >
          Paint…
        </button>
      )}
    </div>
  );
}

/** Each place that looks like the handle's own, and whether it moves along. */
function LookAlikes({ handle }: { readonly handle: number }) {
  const alike = useStore(store, (state) => state.alike);
  const shown = useStore(store, (state) => state.showGhosts);
  const places = alike ? othersOf(store.get()) : [];
  if (places.length === 0) return null;
  return (
    <div class="instances" role="group" aria-label="Look-alikes">
      <Toggle label="Show where it acts" checked={shown} onChange={(showGhosts) => store.set({ showGhosts })} />
      <ul class="rows">
        {places.map(({ vertex, weight, on }, i) => (
          <li key={vertex}>
            <Toggle
              label={`Look-alike ${i + 1} · ${Math.round(100 * weight)} %`}
              checked={on}
              onChange={() => switchLookAlike(handle, vertex)}
            />
          </li>
        ))}
      </ul>
    </div>
  );
}
