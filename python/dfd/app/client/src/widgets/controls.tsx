/** Buttons, fields and menus that all panels share. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";

import { Icon, type IconName } from "./icons";

interface IconButtonProps {
  readonly icon: IconName;
  readonly label: string;
  readonly keys?: string;
  readonly pressed?: boolean;
  readonly disabled?: boolean;
  readonly onPress?: () => void;
}

export function IconButton({ icon, label, keys, pressed, disabled, onPress }: IconButtonProps) {
  return (
    <button
      type="button"
      class="icon-button"
      aria-label={label}
      title={keys ? `${label} (${keys})` : label}
      aria-pressed={pressed}
      disabled={disabled}
      onClick={onPress}
    >
      <Icon name={icon} />
    </button>
  );
}

interface SegmentedProps<Value extends string> {
  readonly label: string;
  readonly value: Value;
  readonly options: readonly (readonly [Value, string])[];
  readonly onChange: (value: Value) => void;
}

export function Segmented<Value extends string>({ label, value, options, onChange }: SegmentedProps<Value>) {
  return (
    <div class="segmented" role="group" aria-label={label}>
      {options.map(([option, text]) => (
        <button key={option} type="button" aria-pressed={option === value} onClick={() => onChange(option)}>
          {text}
        </button>
      ))}
    </div>
  );
}

interface NumberFieldProps {
  readonly label: string;
  readonly value: number;
  readonly step: number;
  readonly onChange: (value: number) => void;
  readonly axis?: "x" | "y" | "z";
}

/** A number to type, or to change by the arrow keys; it is taken when the field is left, as by Enter. */
export function NumberField({ label, value, step, onChange, axis }: NumberFieldProps) {
  const [typed, setTyped] = useState<string | null>(null);
  const take = () => {
    if (typed === null) return;
    const number = Number(typed.replace(",", "."));
    setTyped(null);
    if (typed.trim() !== "" && Number.isFinite(number) && number !== value) onChange(number);
  };
  return (
    <label class={`number ${axis ?? ""}`}>
      {axis && <span aria-hidden="true">{axis.toUpperCase()}</span>}
      <input
        type="text"
        inputMode="decimal"
        aria-label={label}
        value={typed ?? readable(value)}
        onFocus={(event) => event.currentTarget.select()}
        onInput={(event) => setTyped(event.currentTarget.value)}
        onBlur={take}
        onKeyDown={(event) => {
          // What is typed next is meant for the view: there letters are keys.
          if (event.key === "Enter") event.currentTarget.blur();
          if (event.key === "Escape") setTyped(null);
          if (event.key !== "ArrowUp" && event.key !== "ArrowDown") return;
          event.preventDefault();
          const by = step * (event.shiftKey ? 10 : 1) * (event.key === "ArrowUp" ? 1 : -1);
          setTyped(null);
          onChange(Number((value + by).toPrecision(10)));
        }}
      />
    </label>
  );
}

/** As many digits as a field shows. */
export function readable(value: number): string {
  const size = Math.abs(value);
  if (size < 5e-7) return "0";
  if (size < 0.01) return String(Number(value.toPrecision(2)));
  return String(Number(value.toFixed(size < 1 ? 3 : size < 100 ? 2 : 1)));
}

interface SliderProps {
  readonly label: string;
  /** For those who hear it, where `label` stands more than once. */
  readonly of?: string;
  readonly hint?: string;
  readonly value: number;
  readonly min: number;
  readonly max: number;
  readonly step: number;
  readonly disabled?: boolean;
  readonly text: string;
  readonly onInput: (value: number) => void;
}

export function Slider({ label, of = "", hint, value, min, max, step, disabled, text, onInput }: SliderProps) {
  const [held, setHeld] = useState<number | null>(null);
  const shown = held ?? value;
  // What the hand has said last stays until the server has said it too.
  useEffect(() => {
    if (held === null) return undefined;
    const timer = setTimeout(() => setHeld(null), 1000);
    return () => clearTimeout(timer);
  }, [held, value]);
  const part = Math.min(Math.max((shown - min) / (max - min), 0), 1);
  const input = useRef<HTMLInputElement>(null);
  useEffect(() => input.current?.style.setProperty("--part", String(part)), [part]);
  return (
    <div class="slider" title={hint}>
      <span aria-hidden="true">{label}</span>
      <output aria-hidden="true">{text}</output>
      <input
        ref={input}
        type="range"
        min={min}
        max={max}
        step={step}
        value={shown}
        disabled={disabled}
        aria-label={`${label}${of}`}
        aria-valuetext={text}
        onInput={(event) => {
          setHeld(event.currentTarget.valueAsNumber);
          onInput(event.currentTarget.valueAsNumber);
        }}
      />
    </div>
  );
}

interface SelectProps {
  readonly label: string;
  readonly value: string;
  readonly options: readonly string[];
  readonly hint?: string;
  readonly onChange: (value: string) => void;
}

export function Select({ label, value, options, hint, onChange }: SelectProps) {
  return (
    <label class="select" title={hint}>
      <span>{label}</span>
      <select value={value} onChange={(event) => onChange(event.currentTarget.value)}>
        {options.map((option) => (
          <option key={option} value={option}>
            {titled(option)}
          </option>
        ))}
      </select>
    </label>
  );
}

export function titled(name: string): string {
  return name.charAt(0).toUpperCase() + name.slice(1).replaceAll("_", " ");
}

interface ToggleProps {
  readonly label: string;
  readonly checked: boolean;
  readonly onChange: (checked: boolean) => void;
}

export function Toggle({ label, checked, onChange }: ToggleProps) {
  return (
    <label class="toggle">
      <span>{label}</span>
      <input
        type="checkbox"
        role="switch"
        checked={checked}
        onChange={(event) => onChange(event.currentTarget.checked)}
      />
    </label>
  );
}

export interface MenuItem {
  readonly text: string;
  readonly hint?: string;
  readonly disabled?: boolean;
  readonly run: () => void;
}

interface MenuProps {
  readonly icon: IconName;
  readonly label: string;
  readonly text?: string;
  readonly groups: readonly (readonly MenuItem[])[];
}

export function Menu({ icon, label, text, groups }: MenuProps) {
  const [open, setOpen] = useState(false);
  const box = useRef<HTMLDivElement>(null);
  useEffect(() => {
    if (!open) return undefined;
    box.current?.querySelector<HTMLElement>("[role=menuitem]:not(:disabled)")?.focus();
    const outside = (event: Event) => {
      if (!box.current?.contains(event.target as Node)) setOpen(false);
    };
    addEventListener("pointerdown", outside, true);
    return () => removeEventListener("pointerdown", outside, true);
  }, [open]);
  const step = (by: number) => {
    const items = [...(box.current?.querySelectorAll<HTMLElement>("[role=menuitem]:not(:disabled)") ?? [])];
    const at = items.indexOf(document.activeElement as HTMLElement);
    items[(at + by + items.length) % items.length]?.focus();
  };
  return (
    <div
      class="menu"
      ref={box}
      onKeyDown={(event) => {
        if (event.key === "ArrowDown") step(1);
        else if (event.key === "ArrowUp") step(-1);
        else if (event.key === "Escape" && open) {
          setOpen(false);
          box.current?.querySelector("button")?.focus();
        } else return;
        event.preventDefault();
        event.stopPropagation();
      }}
    >
      <button
        type="button"
        class={text ? "button" : "icon-button"}
        aria-label={label}
        title={label}
        aria-haspopup="menu"
        aria-expanded={open}
        onClick={() => setOpen(!open)}
      >
        <Icon name={icon} />
        {text && <span>{text}</span>}
      </button>
      {open && (
        <div class="menu-list" role="menu" aria-label={label}>
          {groups.map((items, i) => (
            <div key={i} role="group">
              {items.map((item) => (
                <button
                  key={item.text}
                  type="button"
                  role="menuitem"
                  disabled={item.disabled}
                  onClick={() => {
                    setOpen(false);
                    item.run();
                  }}
                >
                  <span>{item.text}</span>
                  {item.hint && <small>{item.hint}</small>}
                </button>
              ))}
            </div>
          ))}
        </div>
      )}
    </div>
  );
}

interface PanelProps {
  readonly title: string;
  readonly action?: ComponentChildren;
  readonly children: ComponentChildren;
}

export function Panel({ title, action, children }: PanelProps) {
  return (
    <section class="panel" aria-label={title}>
      <header>
        <h2>{title}</h2>
        {action}
      </header>
      {children}
    </section>
  );
}
