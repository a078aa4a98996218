import { send } from "../actions/connection";
import { change, moveTo } from "../actions/edit";
import { otherPlaces, toggleInstance } from "../actions/similar";
import { niceStep, type Transform } from "../posing/affine";
import type { HandleState } from "../protocol/messages";
import { present, selectedHandle, store } from "../store/state";
import { useParts, useStore } from "../store/use";
import { drawsInSoftware } from "../viewer/stage";
import { Button, count, IconButton, Panel, percent, Scale, Toggle, Triple } from "../widgets/controls";
import { ControlField } from "./control_field";

/** Milliseconds between numbers that change with every frame of a drag: painting them costs more than the frame. */
const readably = () => (store.get().dragging ? (drawsInSoftware() ? 1000 : 100) : 0);

export function HandlePanel({ known }: { readonly known: HandleState }) {
  const state = useStore((all) => all, readably);
  const handle = present(state, known);
  const { transform } = handle;
  const id = handle.handle;
  const step = niceStep((state.mesh?.diagonal ?? 1) / 100);
  const set = (part: Partial<Transform>) => {
    // What is shown may be older than what was set last.
    const now = selectedHandle(store.get()) ?? known;
    moveTo(now.handle, { ...present(store.get(), now).transform, ...part });
  };
  const field = (name: string) => <ControlField key={name} name={name} handle={handle} />;
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
      {["reach", "falloff", "locality", "radius", "strength"].map(field)}
      <Toggle
        label="Limit to part"
        checked={handle.within_part}
        onChange={(on) => change(id, { within: on ? "part" : "everywhere" })}
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
      {handle.within > 0 && field("within_width")}
      {field("instances")}
      {handle.instances !== "only" && field("level")}
      <SimilarPlaces handle={id} />
    </Panel>
  );
}

/** Each place that looks like the handle's own, and whether it moves along. */
function SimilarPlaces({ handle }: { readonly handle: number }) {
  const state = useParts();
  const places = otherPlaces(state);
  if (places.length === 0) return null;
  return (
    <div class="instances" role="group" aria-label="Look-alikes">
      <Toggle
        label="Show where it acts"
        checked={state.showGhosts}
        onChange={(showGhosts) => store.set({ showGhosts })}
      />
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
