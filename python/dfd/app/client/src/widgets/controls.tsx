/** Buttons, fields and menus for all panels. */

import type { ComponentChildren, JSX } from "preact";
import { useEffect, useId, useLayoutEffect, useRef, useState } from "preact/hooks";

import type { Vec3 } from "../posing/affine";
import { ACTIONS, toggle, type ActionName } from "../actions/actions";
import { useParts } from "../store/use";
import { Icon, type IconName } from "./icons";

export const count = new Intl.NumberFormat("en");

export function percent(part: number): string {
  return `${Math.round(100 * part)} %`;
}

export function titled(name: string): string {
  return name.charAt(0).toUpperCase() + name.slice(1).replaceAll("_", " ");
}

export function handleCount(handles: number): string {
  return handles === 1 ? "1 handle" : `${handles} handles`;
}

/** Round a number to the digits that a field shows. */
export function readable(value: number): string {
  const size = Math.abs(value);
  if (size < 5e-7) return "0";
  if (size < 0.01) return String(Number(value.toPrecision(2)));
  return String(Number(value.toFixed(size < 1 ? 3 : size < 100 ? 2 : 1)));
}

type ButtonProps = JSX.IntrinsicElements["button"];

interface IconButtonProps extends ButtonProps {
  readonly icon: IconName;
  readonly label: string;
  readonly keys?: string;
}

export function IconButton({ icon, label, keys, ...rest }: IconButtonProps) {
  return (
    <button class="icon-button" aria-label={label} title={keys ? `${label} (${keys})` : label} {...rest}>
      <Icon name={icon} />
    </button>
  );
}

interface ActionButtonProps extends ButtonProps {
  readonly action: ActionName & IconName;
  readonly pressed?: boolean;
}

/** A button for an action. */
export function ActionButton({ action, pressed, ...rest }: ActionButtonProps) {
  const { keys, label, run } = ACTIONS[action];
  return <IconButton icon={action} label={label} keys={keys} aria-pressed={pressed} onClick={run} {...rest} />;
}

interface TextButtonProps extends ButtonProps {
  readonly text: string;
  /** The classes "primary" and "small". */
  readonly kind?: string;
}

export function Button({ text, kind = "", ...rest }: TextButtonProps) {
  return (
    <button class={`button ${kind}`} {...rest}>
      {text}
    </button>
  );
}

interface FieldProps<Value> {
  readonly label: string;
  /** A suffix of the label for screen readers, if `label` is not unique. */
  readonly of?: string;
  readonly hint?: string;
  readonly value: Value;
  readonly onChange: (value: Value) => unknown;
}

interface ChoiceProps<Value extends string> extends FieldProps<Value> {
  readonly options: readonly Value[];
  /** Labels of options that differ from their values. */
  readonly named?: Partial<Record<Value, string>>;
}

/** Return a value that shows the user's choice at once, for a second. Within this time, the server confirms it. */
function useAhead<Value>(value: Value): [Value, (chosen: Value) => void] {
  const [held, setHeld] = useState<{ readonly chosen: Value } | null>(null);
  useEffect(() => {
    if (held === null) return undefined;
    const timer = setTimeout(() => setHeld(null), 1000);
    return () => clearTimeout(timer);
  }, [held, value]);
  return [held ? held.chosen : value, (chosen) => setHeld({ chosen })];
}

/** A choice among a few words, all of which are visible. */
export function Segmented<Value extends string>({ label, value, options, hint, named, onChange }: ChoiceProps<Value>) {
  const [chosen, choose] = useAhead(value);
  return (
    <div class="segmented" role="group" aria-label={label} aria-description={hint} title={hint}>
      {options.map((option) => (
        <button
          key={option}
          aria-pressed={option === chosen}
          onClick={() => {
            choose(option);
            onChange(option);
          }}
        >
          {titled(named?.[option] ?? option)}
        </button>
      ))}
    </div>
  );
}

export function Select<Value extends string>({ label, value, options, hint, named, onChange }: ChoiceProps<Value>) {
  return (
    <label class="select" title={hint}>
      <span>{label}</span>
      <select value={value} aria-description={hint} onChange={(event) => onChange(event.currentTarget.value as Value)}>
        {options.map((option) => (
          <option key={option} value={option}>
            {titled(named?.[option] ?? option)}
          </option>
        ))}
      </select>
    </label>
  );
}

interface NumberFieldProps extends FieldProps<number> {
  readonly step: number;
  readonly axis?: "x" | "y" | "z";
}

/** A number field. The arrow keys change the number by `step`. */
export function NumberField({ label, value, step, onChange, axis, hint }: NumberFieldProps) {
  // The typed text stays until the user enters it, even if the value changes.
  const [typed, setTyped] = useState<string | null>(null);
  return (
    <label class="number">
      {axis && <span aria-hidden="true">{axis.toUpperCase()}</span>}
      <input
        type="number"
        step={step}
        aria-label={label}
        aria-description={hint}
        value={typed ?? readable(value)}
        onFocus={(event) => event.currentTarget.select()}
        onInput={(event) => setTyped(event.currentTarget.value)}
        onChange={({ currentTarget: { valueAsNumber } }) => {
          setTyped(null);
          if (Number.isFinite(valueAsNumber)) onChange(valueAsNumber);
        }}
        onBlur={() => setTyped(null)}
        // Without the focus on the field, letters are keyboard shortcuts again.
        onKeyDown={(event) => event.key === "Enter" && event.currentTarget.blur()}
      />
    </label>
  );
}

/** A number field with a label. */
export function NumberRow(props: NumberFieldProps) {
  return (
    <div class="select" title={props.hint}>
      <span aria-hidden="true">{props.label}</span>
      <NumberField {...props} />
    </div>
  );
}

interface RenameProps {
  readonly name: string;
  /** Called with the new name; with null if the user keeps the old one. */
  readonly onDone: (name: string | null) => unknown;
}

/** A field that has the focus and a new name. Enter keeps the name, and Esc does not. */
export function Rename({ name, onDone }: RenameProps) {
  return (
    <input
      class="rename"
      aria-label={`New name of ${name}`}
      defaultValue={name}
      ref={(input) => input?.focus()}
      onFocus={(event) => event.currentTarget.select()}
      onBlur={({ currentTarget: { value } }) => onDone(value.trim() && value.trim() !== name ? value.trim() : null)}
      onKeyDown={(event) => {
        if (event.key === "Escape") event.currentTarget.value = name;
        if (event.key === "Enter" || event.key === "Escape") event.currentTarget.blur();
        event.stopPropagation();
      }}
    />
  );
}

const AXES = ["x", "y", "z"] as const;

/** Three number fields, one per axis. */
export function Triple({ label, of = "", hint, value, step, onChange }: FieldProps<Vec3> & { readonly step: number }) {
  return (
    <div class="triple" role="group" aria-label={`${label}${of}`} aria-description={hint} title={hint}>
      <span>{label}</span>
      {AXES.map((axis, i) => (
        <NumberField
          key={axis}
          axis={axis}
          label={`${label}${of} ${axis}`}
          value={value[i]}
          step={step}
          onChange={(number) => onChange(value.with(i, number) as unknown as Vec3)}
        />
      ))}
    </div>
  );
}

interface SliderProps extends FieldProps<number> {
  readonly range: readonly [min: number, max: number, step: number];
  readonly text: string;
}

export function Slider({ label, of = "", hint, value, range: [min, max, step], text, onChange }: SliderProps) {
  const [shown, setHeld] = useAhead(value);
  return (
    <div class="slider" title={hint}>
      <span aria-hidden="true">{label}</span>
      <output aria-hidden="true">{text}</output>
      <input
        type="range"
        min={min}
        max={max}
        step={step}
        value={shown}
        aria-label={`${label}${of}`}
        aria-valuetext={text}
        aria-description={hint}
        onInput={(event) => {
          setHeld(event.currentTarget.valueAsNumber);
          onChange(event.currentTarget.valueAsNumber);
        }}
      />
    </div>
  );
}

export function Toggle({ label, hint, value, onChange }: FieldProps<boolean>) {
  return (
    <label class="toggle" title={hint}>
      <span>{label}</span>
      <input
        type="checkbox"
        role="switch"
        aria-description={hint}
        checked={value}
        onChange={(event) => onChange(event.currentTarget.checked)}
      />
    </label>
  );
}

/** A menu item, which is disabled if `run` is null. */
export type MenuItem = readonly [text: string, hint: string, run: (() => unknown) | null];

/** Items of a menu under a title, which may be empty. */
export type MenuGroup = readonly [title: string, items: readonly MenuItem[]];

interface MenuProps {
  readonly icon: IconName;
  readonly label: string;
  readonly text?: string;
  readonly groups: readonly MenuGroup[];
}

/** A menu in a popover, which the browser opens, places beside its button, and closes. */
export function Menu({ icon, label, text, groups }: MenuProps) {
  const id = useId();
  const step = (event: KeyboardEvent & { readonly currentTarget: HTMLElement }) => {
    const by = event.key === "ArrowDown" ? 1 : event.key === "ArrowUp" ? -1 : 0;
    const items = itemsOf(event.currentTarget);
    items.at((items.indexOf(document.activeElement as HTMLElement) + by) % items.length)?.focus();
    if (by !== 0) event.preventDefault();
  };
  return (
    <div>
      <button class={text ? "button" : "icon-button"} aria-label={label} title={label} popovertarget={id}>
        <Icon name={icon} />
        {text && <span>{text}</span>}
      </button>
      <div
        id={id}
        class="menu-list"
        role="menu"
        aria-label={label}
        popover="auto"
        onToggle={({ newState, currentTarget }) => newState === "open" && itemsOf(currentTarget)[0]?.focus()}
        onKeyDown={step}
        onClick={({ currentTarget }) => currentTarget.hidePopover()}
      >
        {groups.map(([title, group], i) => (
          <div key={i} role="group" aria-label={title || undefined} hidden={group.length === 0}>
            {title && <p class="menu-title">{title}</p>}
            {group.map(([line, hint, run], number) => (
              <button key={number} role="menuitem" disabled={!run} onClick={() => run?.()}>
                <span>{line}</span>
                {hint && <small>{hint}</small>}
              </button>
            ))}
          </div>
        ))}
      </div>
    </div>
  );
}

function itemsOf(menu: HTMLElement): HTMLElement[] {
  return [...menu.querySelectorAll<HTMLElement>("button:enabled")];
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

interface DialogProps extends Pick<PanelProps, "title" | "children"> {
  readonly role?: "alertdialog";
  readonly label?: string;
  readonly wide?: boolean;
  /** Called when the user closes the dialog. Without it, the dialog stays. */
  readonly onClose?: () => unknown;
}

/** A dialog over the page. The browser keeps the focus in it, and closes it with Esc or a press beside it. */
export function Dialog({ title, role, label = title, wide, onClose, children }: DialogProps) {
  const box = useRef<HTMLDialogElement>(null);
  useLayoutEffect(() => box.current?.showModal(), []);
  const [kind, closedby] = [wide ? "wide" : undefined, onClose ? "any" : "none"] as const;
  return (
    <dialog ref={box} class={kind} role={role} aria-label={label} closedby={closedby} onClose={onClose}>
      <header>
        <h2>{title}</h2>
        {onClose && <IconButton icon="remove" label="Close" keys="Esc" onClick={onClose} />}
      </header>
      {children}
    </dialog>
  );
}

interface PlaceProps {
  /** The classes of the dot before the name. */
  readonly dot: string;
  readonly name: string;
  readonly note?: string;
  /** The verb of the button, such as "Remove". */
  readonly verb: string;
  readonly onRemove: () => unknown;
  readonly children?: ComponentChildren;
}

/** A row of a list of places: its name, a button that removes the place, and fields below. */
export function PlaceRow({ dot, name, note, verb, onRemove, children }: PlaceProps) {
  return (
    <li class="row tall">
      <span class="row-name">
        <span class={`dot ${dot}`} aria-hidden="true" />
        <span>{name}</span>
        {note && <small>{note}</small>}
      </span>
      <IconButton icon="remove" label={`${verb} ${name}`} onClick={onRemove} />
      {children}
    </li>
  );
}

/** A button that shows or hides rarely used settings, in all panels at once. */
export function More({ children }: Pick<PanelProps, "children">) {
  const { more } = useParts();
  return (
    <>
      <button class="more" aria-expanded={more} onClick={() => toggle("more")}>
        {more ? "Less" : "More"}
      </button>
      {more && children}
    </>
  );
}
