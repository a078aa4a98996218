/** Marks over the canvas: handles, fixed places, counterparts, suggestions and the point under the pointer. */

import type { Vec3 } from "../../posing/affine";

export interface Mark {
  readonly key: string;
  readonly kind: "handle" | "fixed" | "counterpart" | "suggestion" | "hover";
  readonly at: Vec3;
  readonly label: string;
  readonly selected?: boolean;
  readonly off?: boolean;
  /** The color of the handle. */
  readonly color?: string;
  readonly press?: () => void;
}

export class Markers {
  private readonly elements = new Map<string, HTMLElement>();
  private marks: readonly Mark[] = [];

  constructor(
    private readonly layer: HTMLElement,
    private readonly project: (point: Vec3) => readonly [number, number] | null,
  ) {}

  show(marks: readonly Mark[]): void {
    this.marks = marks;
    const wanted = new Set(marks.map((mark) => mark.key));
    for (const [key, element] of this.elements) {
      if (wanted.has(key)) continue;
      element.remove();
      this.elements.delete(key);
    }
    for (const mark of marks) this.update(mark);
    this.place();
  }

  /** Move each mark to the present position of its point. */
  place(): void {
    for (const { key, at } of this.marks) {
      const element = this.elements.get(key);
      if (!element) continue;
      const pixel = this.project(at);
      element.style.visibility = pixel ? "visible" : "hidden";
      if (pixel) element.style.transform = `translate(${pixel[0].toFixed(1)}px, ${pixel[1].toFixed(1)}px)`;
    }
  }

  private update({ key, kind, label, selected, off, color, press }: Mark): void {
    let element = this.elements.get(key);
    if (!element) {
      element = document.createElement(press ? "button" : "div");
      if (press) element.setAttribute("type", "button");
      this.elements.set(key, element);
      this.layer.append(element);
    }
    element.className = `mark ${kind}${selected ? " selected" : ""}${off ? " off" : ""}`;
    element.title = label;
    element.ariaLabel = label;
    if (color) element.style.setProperty("--own", color);
    if (press) element.onclick = press;
  }
}
