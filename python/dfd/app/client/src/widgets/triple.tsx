/** Three numbers, one for each axis. */

import type { ComponentChildren } from "preact";

import { store } from "../store/state";
import { useStore } from "../store/use";
import type { Vec3 } from "../viewer/posing/affine";
import { IconButton, NumberField } from "./controls";

const AXES = ["x", "y", "z"] as const;

interface TripleProps {
  readonly label: string;
  readonly value: Vec3;
  readonly step: number;
  readonly onChange: (value: Vec3) => void;
  /** For those who hear it, where `label` stands more than once. */
  readonly of?: string;
  readonly action?: ComponentChildren;
}

export function Triple({ label, of = "", value, step, onChange, action }: TripleProps) {
  return (
    <div class="triple" role="group" aria-label={`${label}${of}`}>
      <span class="triple-label">
        {label}
        {action}
      </span>
      {AXES.map((axis, i) => (
        <NumberField
          key={axis}
          axis={axis}
          label={`${label}${of} ${axis}`}
          value={value[i]}
          step={step}
          onChange={(number) => onChange(value.map((other, j) => (j === i ? number : other)) as unknown as Vec3)}
        />
      ))}
    </div>
  );
}

interface ScaleProps {
  readonly value: Vec3;
  readonly of?: string;
  readonly onChange: (value: Vec3) => void;
}

/** One factor for all axes where they are alike, and a switch to have three. */
export function Scale({ value, of = "", onChange }: ScaleProps) {
  const uniform = useStore(store, (state) => state.uniformScale);
  return (
    <div class="triple" role="group" aria-label={`Scale${of}`}>
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
          label={`Scale${of} ${axis}`}
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
