let probe: HTMLElement | null = null;

/** A color of the style sheets as the present theme has it: variables alone keep both of their sides. */
export function themeColor(name: string): string {
  if (!probe) {
    probe = document.createElement("span");
    probe.hidden = true;
    document.body.append(probe);
  }
  probe.style.color = `var(${name})`;
  return getComputedStyle(probe).color;
}
