import { send } from "../actions/connection";
import { change, moveTo, slide, throttle } from "../actions/edit";
import { otherPlaces, toggleInstance } from "../actions/similar";
import { niceStep, type Transform } from "../posing/affine";
import { heldPart } from "../posing/columns";
import type { HandleState } from "../protocol/messages";
import { present, selectedHandle, store } from "../store/state";
import { useStore } from "../store/use";
import { drawsInSoftware } from "../viewer/stage";
import {
  Button,
  count,
  IconButton,
  Panel,
  percent,
  readable,
  Scale,
  Select,
  Slider,
  Toggle,
  Triple,
} from "../widgets/controls";

const FALLOFFS: Record<HandleState["falloff"], string> = {
  linear: "Linear",
  smooth: "Smooth",
  sharp: "Sharp",
  root: "Root",
  sphere: "Sphere",
  constant: "Constant",
};
const INSTANCES: Record<HandleState["instances"], string> = { own: "Own", together: "Together", only: "Only" };

/** Milliseconds between numbers that change with every frame of a drag: painting them costs more than the frame. */
const readably = () => (store.get().dragging ? (drawsInSoftware() ? 1000 : 100) : 0);

export function HandlePanel({ known }: { readonly known: HandleState }) {
  const state = useStore((all) => all, readably);
  const handle = present(state, known);
  const { transform, radius } = handle;
  const id = handle.handle;
  const size = state.mesh?.diagonal ?? 1;
  const step = niceStep(size / 100);
  const set = (part: Partial<Transform>) => {
    // What is shown may be older than what was set last.
    const now = selectedHandle(store.get()) ?? known;
    moveTo(now.handle, { ...present(store.get(), now).transform, ...part });
  };
  const column = state.columns.get(handle.column);
  const held = column ? heldPart(column.layer, handle.reach, handle.falloff) : 0;
  const reset = (
    <IconButton
      icon="reset"
      label="Return this handle to rest"
      keys="0"
      disabled={!known.moved}
      onPress={() => send({ type: "reset", handle: id })}
    />
  );
  const resetPivot = (
    <IconButton
      icon="reset"
      label="Return the pivot to the handle"
      disabled={transform.pivot === null}
      onPress={() => set({ pivot: null })}
    />
  );
  return (
    <Panel title="Transform and reach" action={reset}>
      <Triple label="Move" value={transform.translation} step={step} onChange={(translation) => set({ translation })} />
      <Triple label="Rotate °" value={transform.rotation} step={1} onChange={(rotation) => set({ rotation })} />
      <Scale value={transform.scale} onChange={(scale) => set({ scale })} />
      <Toggle
        label="Scale along the surface"
        checked={transform.axes !== null}
        onChange={(on) => send({ type: "move", handle: id, transform: { axes: on ? "normal" : "auto" }, settle: true })}
      />
      <Triple
        label="Pivot"
        value={transform.pivot ?? handle.position}
        step={step}
        onChange={(pivot) => set({ pivot })}
        action={resetPivot}
      />
      <Slider
        label="Reach"
        hint="How unlike the handle something may look and still follow; also the wheel while dragging, or [ and ]"
        value={handle.reach}
        range={[0.05, 1.5, 0.01]}
        text={`${handle.reach.toFixed(2)} · holds ${percent(held)}`}
        onInput={(reach) => slide(id, { reach })}
      />
      <Select
        label="Falloff"
        value={handle.falloff}
        options={FALLOFFS}
        onChange={(falloff) => change(id, { falloff })}
      />
      <Slider
        label="Locality"
        hint="0 reaches all that looks alike; more stays near the handle along the surface"
        value={handle.locality}
        range={[0, 20, 0.5]}
        text={radius !== null ? "by radius" : handle.locality === 0 ? "everywhere" : handle.locality.toFixed(1)}
        onInput={(locality) => slide(id, { locality })}
      />
      <Slider
        label="Radius"
        hint="How far along the surface the handle acts, in parts of the shape's size; the other way to say locality"
        value={(radius ?? 0) / size}
        range={[0, 1, 0.01]}
        text={radius === null ? "no limit" : `${readable(radius)} · ${percent(radius / size)}`}
        onInput={(part) => slide(id, part > 0 ? { radius: part * size } : { locality: 0 })}
      />
      <Slider
        label="Strength"
        value={handle.strength}
        range={[0, 1, 0.05]}
        text={percent(handle.strength)}
        onInput={(strength) => slide(id, { strength })}
      />
      <div class="limit">
        <span>Limit</span>
        <span class="limit-text">{handle.within > 0 ? `${count.format(handle.within)} vertices` : "none"}</span>
        {handle.within > 0 ? (
          <Button text="Remove" style="small" onPress={() => change(id, { within: "everywhere" })} />
        ) : (
          <Button
            text="Paint…"
            style="small"
            title="Paint where the handle may act"
            onPress={() => store.set({ tool: "paint" })}
          />
        )}
      </div>
      {handle.within > 0 && (
        <Slider
          label="Limit's edge"
          hint="How far beyond the limit the handle fades, in parts of the shape's size; 0 cuts it off"
          value={handle.within_width / size}
          range={[0, 0.3, 0.005]}
          text={handle.within_width === 0 ? "sharp" : `${readable(handle.within_width)} wide`}
          onInput={(part) =>
            throttle(`${id} within_width`, (merge) =>
              send({ type: "change", handle: id, controls: { within_width: part * size }, merge }),
            )
          }
        />
      )}
      <Select
        label="Look-alikes"
        hint="How the handle's look-alikes move: each about its own pivot, together, or not at all"
        value={handle.instances}
        options={INSTANCES}
        onChange={(instances) => change(id, { instances })}
      />
      {handle.instances !== "only" && (
        <Toggle label="Look-alikes follow in full" checked={handle.level} onChange={(level) => change(id, { level })} />
      )}
      <SimilarPlaces handle={id} />
    </Panel>
  );
}

/** Each place that looks like the handle's own, and whether it moves along. */
function SimilarPlaces({ handle }: { readonly handle: number }) {
  const places = useStore(otherPlaces);
  const shown = useStore((state) => state.showGhosts);
  if (places.length === 0) return null;
  return (
    <div class="instances" role="group" aria-label="Look-alikes">
      <Toggle label="Show where it acts" checked={shown} onChange={(showGhosts) => store.set({ showGhosts })} />
      <ul class="rows">
        {places.map(({ vertex, weight, on }, i) => (
          <li key={vertex}>
            <Toggle
              label={`Look-alike ${i + 1} · ${percent(weight)}`}
              checked={on}
              onChange={() => toggleInstance(handle, vertex)}
            />
          </li>
        ))}
      </ul>
    </div>
  );
}
