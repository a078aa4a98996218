import { change, slide } from "../actions/edit";
import type { HandleState } from "../protocol/messages";
import { store } from "../store/state";
import { useParts } from "../store/use";
import { held } from "../viewer/scene";
import { percent, Segmented, Select, Slider, Toggle } from "../widgets/controls";

/** What a slider says of the present value, where that is more than a number. */
const TEXTS: Partial<Record<string, (handle: HandleState, size: number) => string>> = {
  reach: ({ handle }) => `holds ${percent(held(store.get(), handle))}`,
  locality: ({ locality, radius }) =>
    radius !== null ? "by radius" : locality === 0 ? "everywhere" : locality.toFixed(1),
  radius: ({ radius }, size) => (radius === null ? "no limit" : `${percent(radius / size)} of the size`),
  mask_feather: ({ mask_feather }, size) =>
    mask_feather === 0 ? "sharp" : `${percent(mask_feather / size)} of the size`,
};

interface ControlProps {
  readonly name: string;
  readonly handle: HandleState;
}

/** A control of a handle as the server describes it. */
export function ControlField({ name, handle }: ControlProps) {
  const { session, mesh } = useParts();
  const entry = session?.controls.find((each) => each.name === name);
  const size = mesh?.diagonal ?? 1;
  if (!entry) return null;
  const { label, hint, kind, choices, slider } = entry;
  const value = handle[name as keyof HandleState];
  const id = handle.handle;
  if (kind === "switch")
    return <Toggle label={label} hint={hint} checked={value === true} onChange={(on) => change(id, { [name]: on })} />;
  if (slider === null) {
    return (
      <Select
        label={label}
        hint={hint}
        value={String(value)}
        options={choices}
        onChange={(word) => change(id, { [name]: word })}
      />
    );
  }
  const unit = kind === "length" ? size : 1;
  const number = Number(value);
  const field = (
    <Slider
      label={label}
      hint={hint}
      value={number / unit}
      range={slider}
      text={TEXTS[name]?.(handle, size) ?? percent(number)}
      // A radius of nothing is none: all along the surface follows.
      onInput={(part) => slide(id, name === "radius" && part === 0 ? { locality: 0 } : { [name]: part * unit })}
    />
  );
  if (name !== "reach") return field;
  const setBy = (word: string) => change(id, { reach: word === "number" ? handle.reach : (word as "auto" | "part") });
  return (
    <>
      {field}
      <Segmented
        label="Reach by"
        hint="Up to the part's border, as far as suits what looks alike, or as set"
        value={handle.reach_by}
        options={[...choices, "number"]}
        onChange={setBy}
      />
    </>
  );
}
