import { change, slide } from "../actions/edit";
import type { HandleState } from "../protocol/messages";
import { store } from "../store/state";
import { useParts } from "../store/use";
import { held } from "../viewer/scene";
import { percent, Segmented, Select, Slider, Toggle } from "../widgets/controls";

/** Texts beside sliders, for controls whose value is shown in words or as a share of the shape. */
const TEXTS: Partial<Record<string, (handle: HandleState, size: number) => string>> = {
  reach: ({ handle }) => `moves ${percent(held(store.get(), handle))}`,
  locality: ({ locality, radius }) =>
    radius !== null ? "by radius" : locality === 0 ? "everywhere" : locality.toFixed(1),
  radius: ({ radius }, size) => (radius === null ? "no limit" : `${percent(radius / size)} of the size`),
  mask_feather: ({ mask_feather }, size) =>
    mask_feather === 0 ? "sharp" : `${percent(mask_feather / size)} of the size`,
};

/** Words of a choice that is shown with all its words. */
const FOLLOWERS: Record<string, string> = { all: "All alike", mirror: "Mirrored", none: "Only this" };

/** A control of a handle, as the server describes it. */
export function ControlField({ name, handle }: { readonly name: string; readonly handle: HandleState }) {
  const { session, mesh } = useParts();
  const entry = session?.controls.find((each) => each.name === name);
  const size = mesh?.diagonal ?? 1;
  if (!entry) return null;
  const { label, hint, kind, choices, slider } = entry;
  const value = handle[name as keyof HandleState];
  const id = handle.handle;
  const set = (given: unknown) => change(id, { [name]: given });
  if (kind === "switch") return <Toggle label={label} hint={hint} value={value === true} onChange={set} />;
  if (name === "follow")
    return (
      <>
        <p class="label">{label}</p>
        <Segmented label={label} hint={hint} value={handle.follow} options={choices} named={FOLLOWERS} onChange={set} />
      </>
    );
  if (slider === null)
    return <Select label={label} hint={hint} value={value as string} options={choices} onChange={set} />;
  const unit = kind === "length" ? size : 1;
  const number = Number(value);
  return (
    <>
      <Slider
        label={label}
        hint={hint}
        value={number / unit}
        range={slider}
        text={TEXTS[name]?.(handle, size) ?? percent(number)}
        // A radius of 0 removes the radius.
        onChange={(part) => slide(id, name === "radius" && part === 0 ? { locality: 0 } : { [name]: part * unit })}
      />
      {name === "reach" && (
        <Segmented
          label="Reach by"
          hint="The handle moves its part up to the border, or all surface within a feature distance"
          value={handle.reach_by}
          options={[...choices, "number"]}
          onChange={(word) => set(word === "number" ? handle.reach : word)}
        />
      )}
    </>
  );
}
