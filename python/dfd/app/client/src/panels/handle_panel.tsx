import { send } from "../actions/connection";
import { change, moveTo } from "../actions/edit";
import { otherPlaces, toggleInstance } from "../actions/similar";
import { followed, LEAST_SEEN } from "../posing/held";
import { niceStep, type PivotAt, type Transform } from "../posing/affine";
import type { AxisMessage, HandleState } from "../protocol/messages";
import { handleName, present, selectedHandle, store, type GizmoMode, type State } from "../store/state";
import { readably, useParts } from "../store/use";
import { columnsOf } from "../viewer/scene";
import {
  Button,
  count,
  IconButton,
  More,
  NumberField,
  Panel,
  percent,
  Scale,
  Select,
  Toggle,
  Triple,
} from "../widgets/controls";
import { ControlField } from "./control_field";

export function HandlePanel({ known }: { readonly known: HandleState }) {
  const state = useParts(readably);
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
  const verb = {
    ...motionFields(transform, step, set),
    bend: (
      <>
        <>
          <Bend handle={id} transform={transform} set={set} />
        </>
      </>
    ),
  };
  const others = (Object.keys(verb) as GizmoMode[]).filter((name) => name !== state.gizmo);
  return (
    <Panel title={handleName(handle)} action={reset}>
      {verb[state.gizmo]}
      {state.gizmo !== "translate" && (
        <>
          <PivotChoice handle={handle} axis={state.axis} />
        </>
      )}
      {field("reach")}
      <>
        {handle.instances !== "only" && field("level")}
        <SimilarPlaces state={state} handle={id} />
        <>
          <Toggle
            label="Limit to part"
            hint="Nothing beyond the part that is held moves"
            checked={handle.mask_part}
            onChange={(on) => change(id, { mask: on ? "part" : "everywhere" })}
          />
        </>
      </>
      <More>
        {others.map((name) => verb[name])}
        <Triple
          label="Pivot"
          hint="The point about which it turns and scales"
          value={transform.pivot ?? handle.position}
          step={step}
          onChange={(pivot) => set({ pivot, pivotAt: null })}
        />
        {["falloff", "strength"].map(field)}
        <>
          <Toggle
            label="Scale along the surface"
            hint="Along the surface's normal and across it, not along x, y and z"
            checked={transform.axes !== null}
            onChange={(on) =>
              send({ type: "move", handle: id, transform: { axes: on ? "normal" : "auto" }, settle: true })
            }
          />
          {["locality", "radius"].map(field)}
          <div class="limit" title="A region beyond which nothing follows">
            <span>Limit</span>
            <span class="limit-text">{handle.mask > 0 ? `${count.format(handle.mask)} vertices` : "none"}</span>
            {handle.mask > 0 ? (
              <Button text="Remove" style="small" onPress={() => change(id, { mask: "everywhere" })} />
            ) : (
              <Button
                text="Paint…"
                style="small"
                title="Paint where the handle may act"
                onPress={() => store.set({ tool: "paint" })}
              />
            )}
          </div>
          {handle.mask > 0 && field("mask_feather")}
          {field("instances")}
        </>
      </More>
    </Panel>
  );
}

/** Fields of what is done to a handle, or to the rest of the shape, by the verb. */
export function motionFields(now: Transform, step: number, set: (part: Partial<Transform>) => void, of = "") {
  const angles = "An axis times an angle; about one axis alone, its angle";
  const far = "How far, in the shape's own units";
  return {
    translate: (
      <Triple
        key="translate"
        label="Move"
        of={of}
        hint={far}
        value={now.translation}
        step={step}
        onChange={(translation) => set({ translation })}
      />
    ),
    rotate: (
      <Triple
        key="rotate"
        label="Rotate °"
        of={of}
        hint={angles}
        value={now.rotation}
        step={1}
        onChange={(rotation) => set({ rotation })}
      />
    ),
    scale: <Scale key="scale" of={of} value={now.scale} onChange={(scale) => set({ scale })} />,
  };
}

const PIVOTS: Record<PivotAt, string> = {
  base: "base of the part",
  middle: "middle of the part",
  hinge: "hinge of the part",
  point: "where it is held",
  plane: "on the mirror plane",
};

/** What it turns about: found by the session, unless it is chosen. */
function PivotChoice({ handle, axis }: { readonly handle: HandleState; readonly axis: AxisMessage | null }) {
  const known = (axis?.handle === handle.handle ? Object.keys(axis.pivots) : ["point"]) as PivotAt[];
  const value = handle.pivot_at ?? (handle.pivot_set ? "as set" : "auto");
  const names: readonly string[] = ["auto", ...known, ...(value === "as set" ? [value] : [])];
  return (
    <Select
      label="Turns about"
      hint="The base of a limb, the middle of a head, or what is chosen"
      value={value}
      options={names}
      named={{ auto: "what is found", ...PIVOTS }}
      onChange={(name) =>
        send({ type: "move", handle: handle.handle, transform: { pivot: name as PivotAt | "auto" }, settle: true })
      }
    />
  );
}

interface BendProps {
  readonly handle: number;
  readonly transform: Transform;
  readonly set: (part: Partial<Transform>) => void;
}

/** How far the tip bends, and turns about the part's own axis. */
function Bend({ handle, transform: { bend, twist, joint }, set }: BendProps) {
  const [bends, twists] = [
    "How far the tip of what is held bends; drag it in the view for any direction",
    "How far the tip turns about the part's own axis",
  ];
  const degrees = Math.hypot(...bend);
  // What does not bend yet bends up, or to the front.
  const bendBy = (angle: number) =>
    degrees === 0
      ? send({ type: "move", handle, transform: { bend: angle }, settle: true })
      : set({ bend: bend.map((part) => (part * angle) / degrees) as unknown as Transform["bend"] });
  return (
    <div class="bend" role="group" aria-label="Bend and twist">
      <label class="select" title={bends}>
        <span>Bend °</span>
        <NumberField label="Bend °" value={degrees} step={1} hint={bends} onChange={bendBy} />
      </label>
      <label class="select" title={twists}>
        <span>Twist °</span>
        <NumberField label="Twist °" value={twist} step={1} hint={twists} onChange={(angle) => set({ twist: angle })} />
      </label>
      <Select
        label="Bends"
        value={joint === null ? "spread" : "joint"}
        options={["spread", "auto", "here", ...(joint === null ? [] : ["joint"])]}
        named={{
          spread: "all along",
          auto: "at its joint",
          here: "where it is held",
          joint: `at ${percent(joint ?? 0)}`,
        }}
        hint="Over all of the part, or about a joint such as a knee"
        onChange={(name) => {
          if (name !== "joint")
            send({ type: "move", handle, transform: { joint: name as "spread" | "auto" | "here" }, settle: true });
        }}
      />
    </div>
  );
}

/** Each place that looks like the handle's own, and how much it moves along: gray where none of it is seen. */
function SimilarPlaces({ state, handle }: { readonly state: State; readonly handle: number }) {
  const places = otherPlaces(state);
  if (places.length === 0) return null;
  const columns = columnsOf(state, handle);
  return (
    <div class="instances" role="group" aria-label="Look-alikes">
      <Toggle
        label="Show where it acts"
        hint="Marks on all that looks alike; press one to leave it behind"
        checked={state.showGhosts}
        onChange={(showGhosts) => store.set({ showGhosts })}
      />
      <ul class="rows">
        {places.map(({ vertex, on }, i) => {
          const follows = followed(columns, vertex);
          return (
            <li key={vertex} class={on && follows < LEAST_SEEN ? "stays" : undefined}>
              <Toggle
                label={`Look-alike ${i + 1} · ${percent(follows)}`}
                hint="How much of it follows"
                checked={on}
                onChange={() => toggleInstance(handle, vertex)}
              />
            </li>
          );
        })}
      </ul>
    </div>
  );
}
