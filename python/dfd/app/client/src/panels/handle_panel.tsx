import { useEffect, useState } from "preact/hooks";

import { ask } from "../actions/connection";
import type { Request } from "../protocol/binary_messages";
import { change, changePart, move, setMotion, toggleCounterpart, type PartChange } from "../actions/edit";
import { copyPlace } from "../actions/files";
import { niceStep, type PivotAt, type Transform, type Vec3 } from "../posing/affine";
import { followed, LEAST_SEEN } from "../posing/held";
import type { HandleState } from "../protocol/messages";
import { handleName, otherPlaces, present, stepAt, stepText, store, type GizmoMode, type State } from "../store/state";
import { useParts } from "../store/use";
import { columnsOf } from "../viewer/scene";
import {
  Button,
  count,
  ActionButton,
  IconButton,
  More,
  NumberRow,
  Panel,
  percent,
  Select,
  titled,
  Toggle,
  Triple,
} from "../widgets/controls";
import { ControlField } from "./control_field";

/** Controls that are always visible. */
const SHOWN = ["follow", "reach", "locality"];

export function HandlePanel({ known }: { readonly known: HandleState }) {
  const state = useParts();
  const handle = present(state, known);
  const { transform } = handle;
  const id = handle.handle;
  const step = niceStep((state.mesh?.diagonal ?? 1) / 100);
  const names = (state.session?.controls ?? []).map(({ name }) => name).filter((name) => name in handle);
  const folded = names.filter((name) => !SHOWN.includes(name) && (name !== "mask_feather" || handle.mask > 0));
  const field = (name: string) => <ControlField key={name} name={name} handle={handle} />;
  const verb = {
    ...motionFields(transform, step, setMotion),
    bend: <Bend key="bend" handle={id} transform={transform} />,
  };
  const pivots = state.axis?.handle === id ? state.axis.pivots : (["point"] as const);
  const pivot = handle.pivot_at ?? (handle.pivot_set ? "as set" : "auto");
  const others = (Object.keys(verb) as GizmoMode[]).filter((name) => name !== state.gizmo);
  return (
    <Panel
      title={handleName(handle)}
      action={
        <div class="bar-group">
          <IconButton icon="copy" label="Copy the place" onClick={() => void copyPlace(known)} />
          <ActionButton action="reset" disabled={!known.moved} />
        </div>
      }
    >
      <PartButtons handle={known} />
      {SHOWN.map(field)}
      <Toggle
        label={
          handle.mask === 0 || handle.mask_part ? "Limit to part" : `Limit to ${count.format(handle.mask)} vertices`
        }
        hint="The handle moves only this part or region. Use the brush to paint another region."
        value={handle.mask > 0}
        onChange={(on) => change(id, { mask: on ? "part" : "everywhere" })}
      />
      {verb[state.gizmo]}
      <More>
        <Counterparts state={state} handle={id} />
        {others.map((name) => verb[name])}
        <Select
          label="Rotate about"
          hint="The automatic pivot is the base of a limb, or the middle of any other part"
          value={pivot}
          options={["auto", ...pivots, ...(pivot === "as set" ? [pivot] : [])]}
          named={{ auto: "automatic pivot", ...PIVOTS }}
          onChange={(name) => move(id, { pivot: name as PivotAt | "auto" })}
        />
        <Triple
          label="Pivot"
          hint="The center of rotation and scale"
          value={transform.pivot ?? handle.position}
          step={step}
          onChange={(pivot) => setMotion({ pivot, pivot_at: null })}
        />
        {folded.map(field)}
        <Toggle
          label="Scale along the surface"
          hint="Use the surface's normal and tangents as the axes of scale"
          value={transform.axes !== null}
          onChange={(on) => move(id, { axes: on ? "normal" : "auto" })}
        />
      </More>
    </Panel>
  );
}

const MOTIONS = {
  translate: ["translation", "Move", "The translation in units of the file"],
  rotate: ["rotation", "Rotate °", "The rotation vector: the direction is the axis, the length is the angle"],
  scale: ["scale", "Scale", "Factors along x, y and z"],
} as const;

/** Return input fields for the translation, rotation and scale in `now`. `of` is appended to the labels. */
export function motionFields(now: Transform, step: number, set: (part: Partial<Transform>) => void, of = "") {
  const steps = { translation: step, rotation: 1, scale: 0.05 };
  const field = (name: keyof typeof MOTIONS) => {
    const [key, label, hint] = MOTIONS[name];
    const change = (value: Vec3) => (key !== "scale" || value.every((factor) => factor !== 0)) && set({ [key]: value });
    return <Triple key={name} label={label} of={of} hint={hint} value={now[key]} step={steps[key]} onChange={change} />;
  };
  return { translate: field("translate"), rotate: field("rotate"), scale: field("scale") };
}

const PIVOTS: Record<PivotAt, string> = {
  base: "base of the part",
  middle: "middle of the part",
  hinge: "hinge of the part",
  point: "the handle",
  plane: "on the mirror plane",
};

const JOINTS = { spread: "over its length", auto: "at its joint", here: "at the handle" };

/** The bend and the twist of the handle's part. */
function Bend({ handle, transform }: { readonly handle: number; readonly transform: Transform }) {
  const { bend, twist, joint } = transform;
  const degrees = Math.hypot(...bend);
  // The server chooses the direction of the first bend: up, or to the front.
  const bendBy = (angle: number) =>
    degrees === 0
      ? move(handle, { bend: angle })
      : setMotion({ bend: bend.map((part) => (part * angle) / degrees) as unknown as Transform["bend"] });
  return (
    <>
      <NumberRow
        label="Bend °"
        hint="The angle at the tip. Drag the tip in the view to bend in any direction."
        value={degrees}
        step={1}
        onChange={bendBy}
      />
      <NumberRow
        label="Twist °"
        hint="The angle at the tip about the part's own axis"
        value={twist}
        step={1}
        onChange={(angle) => setMotion({ twist: angle })}
      />
      <Select
        label="Bends"
        value={joint === null ? "spread" : "joint"}
        options={[...Object.keys(JOINTS), ...(joint === null ? [] : ["joint"])]}
        named={{ ...JOINTS, joint: `at ${percent(joint ?? 0)}` }}
        hint="Bend the whole part, or only a joint such as a knee"
        onChange={(name) => name !== "joint" && move(handle, { joint: name as keyof typeof JOINTS })}
      />
    </>
  );
}

/** A switch for each counterpart. Counterparts that do not move visibly are gray. */
function Counterparts({ state, handle }: { readonly state: State; readonly handle: number }) {
  const columns = columnsOf(state, handle);
  const places = otherPlaces(state);
  return (
    <ul class="rows" hidden={places.length === 0}>
      {places.map(({ vertex, on }, i) => {
        const follows = followed(columns, vertex);
        return (
          <li key={vertex} class={on && follows < LEAST_SEEN ? "stays" : undefined}>
            <Toggle
              label={`Counterpart ${i + 1} · ${percent(follows)}`}
              hint="The percentage is the weight at this counterpart"
              value={on}
              onChange={() => toggleCounterpart(handle, vertex)}
            />
          </li>
        );
      })}
    </ul>
  );
}

/** Instead of a part, a handle can hold one of these regions. */
const UNITS: readonly (readonly [way: PartChange, hint: string])[] = [
  ["scene_part", "Give the handle the whole scene part, such as an object"],
  ["material", "Give the handle all faces with this material"],
  ["component", "Give the handle the whole connected component"],
];

const NOT_FOUND =
  "No part was found here, so all surface that looks alike follows. Take another step, or paint a region.";
const LEFT = "Another piece touches this part, and stays behind.";

/** The ladder of parts, and buttons for regions. While the pointer is on one of them, the view shows the new part. */
function PartButtons({ handle }: { readonly handle: HandleState }) {
  const { ladders, edit } = useParts();
  const { handle: id, columns, region, origin, level } = handle;
  const ladder = region === 0 ? ladders.get(origin) : undefined;
  const at = ladder ? stepAt(ladder, level) : 0;
  const [pointed, setPointed] = useState<Request | null>(null);
  const [missing, setMissing] = useState<readonly PartChange[]>([]);
  const held = [id, ...columns.map(({ column }) => column)].join();
  useEffect(() => setMissing([]), [held]);
  useEffect(() => {
    if (!pointed) return undefined;
    let current = true;
    void ask(pointed, true).then((answer) => {
      if (!answer && pointed.type === "take_part") setMissing((others) => [...others, pointed.how]);
      else if (!answer) return;
      else if (current)
        store.set({ probe: { vertex: null, level: 0, exact: true, weights: answer.payload.get("values", "U16") } });
    });
    return () => {
      current = false;
      store.set({ probe: null });
    };
  }, [pointed, held]);
  const leave = () => setPointed(null);
  const point = (to: number) => () =>
    setPointed({ type: "preview", handle: id, controls: { level: to, reach: "part" } });
  const unit = (how: PartChange) => () => setPointed({ type: "take_part", handle: id, how, preview: true });
  const last = ladder ? ladder.steps.length - 1 : 0;
  const step = ladder?.steps[at];
  return (
    <div role="group" aria-label="Part of the handle" onPointerLeave={leave} onFocusOut={leave}>
      {ladder && (
        <>
          <p class="step">{stepText({ ladders }, origin, level)}</p>
          <div class="ladder" role="group" aria-label="Size of the part">
            {ladder.steps.map((each, i) => (
              <button
                key={each.level}

                aria-pressed={i === at}
                aria-label={stepText({ ladders }, origin, each.level)}
                title={stepText({ ladders }, origin, each.level)}
                style={{ "--share": Math.sqrt(each.share) }}
                onPointerEnter={point(each.level)}
                onFocus={point(each.level)}
                onClick={() => change(id, { level: each.level, reach: "part" })}
              />
            ))}
          </div>
        </>
      )}
      {!ladder && region > 0 && (
        <div class="buttons">
          {(["smaller", "larger"] as const).map((way) => (
            <Button key={way} text={titled(way)} kind="small" onClick={() => void changePart(way)} />
          ))}
        </div>
      )}
      {step && !step.found && <p class="empty">{NOT_FOUND}</p>}
      {step?.leaves && <p class="empty">{at === last ? LEFT : `${LEFT} A larger step may take it along.`}</p>}
      <div class="buttons">
        {UNITS.filter(([way]) => edit?.field.parts.includes(way)).map(([way, hint]) => (
          <Button
            key={way}
            text={titled(way)}
            kind="small"
            title={missing.includes(way) ? "There is no such part here" : hint}
            disabled={missing.includes(way)}
            onPointerEnter={unit(way)}
            onFocus={unit(way)}
            onClick={() => void changePart(way)}
          />
        ))}
      </div>
    </div>
  );
}
