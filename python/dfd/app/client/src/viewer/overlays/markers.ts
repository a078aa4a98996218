/** Marks over the canvas: handles, fixed places, instances, suggestions, the point under the pointer, the ring of reach. */

import type { Vec3 } from "../../posing/affine";

export interface Mark {
  readonly key: string;
  readonly kind: "handle" | "fixed" | "instance" | "suggestion" | "hover";
  readonly at: Vec3;
  readonly label: string;
  readonly selected?: boolean;
  readonly off?: boolean;
  /** Its handle's. */
  readonly color?: string;
  readonly press?: () => void;
}

export interface Ring {
  readonly at: Vec3;
  /** Part of the vertices that are held, in [0, 1]. */
  readonly held: number;
  readonly text: string;
}

const SVG = "http://www.w3.org/2000/svg";
const RADIUS = 92;
/** Pixels from the ring's center to below its words. */
const RING_HEIGHT = 136;

export class Markers {
  private readonly elements = new Map<string, HTMLElement>();
  private marks: readonly Mark[] = [];
  private ring: Ring | null = null;
  private readonly ringBox = document.createElement("div");
  private readonly arc = document.createElementNS(SVG, "circle");
  private readonly ringText = document.createElement("span");

  constructor(
    private readonly layer: HTMLElement,
    private readonly project: (point: Vec3) => readonly [number, number] | null,
  ) {
    this.ringBox.className = "ring";
    this.ringBox.hidden = true;
    const picture = document.createElementNS(SVG, "svg");
    picture.setAttribute("viewBox", "-100 -100 200 200");
    const track = document.createElementNS(SVG, "circle");
    for (const circle of [track, this.arc]) {
      circle.setAttribute("r", String(RADIUS));
      circle.setAttribute("pathLength", "1");
    }
    track.setAttribute("class", "track");
    this.arc.setAttribute("class", "arc");
    picture.append(track, this.arc);
    this.ringBox.append(picture, this.ringText);
    layer.append(this.ringBox);
  }

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

  showRing(ring: Ring | null): void {
    this.ring = ring;
    this.ringBox.hidden = ring === null;
    if (ring) {
      // What is set again is painted again.
      const dashes = `${ring.held.toFixed(3)} 1`;
      if (this.arc.getAttribute("stroke-dasharray") !== dashes) this.arc.setAttribute("stroke-dasharray", dashes);
      if (this.ringText.textContent !== ring.text) this.ringText.textContent = ring.text;
    }
    this.place();
  }

  /** Put everything where its point appears now. */
  place(): void {
    for (const mark of this.marks) {
      const element = this.elements.get(mark.key);
      if (element) move(element, this.project(mark.at));
    }
    if (!this.ring) return;
    const at = this.project(this.ring.at);
    move(this.ringBox, at);
    // What the ring says stays in the view.
    const above = at !== null && at[1] + RING_HEIGHT > this.layer.clientHeight;
    if (this.ringBox.classList.contains("above") !== above) this.ringBox.classList.toggle("above", above);
  }

  private update(mark: Mark): void {
    let element = this.elements.get(mark.key);
    if (!element) {
      element = document.createElement(mark.press ? "button" : "div");
      if (mark.press) element.setAttribute("type", "button");
      this.elements.set(mark.key, element);
      this.layer.append(element);
    }
    const name = `mark ${mark.kind}${mark.selected ? " selected" : ""}${mark.off ? " off" : ""}`;
    if (element.className !== name) element.className = name;
    if (element.title !== mark.label) {
      element.title = mark.label;
      element.setAttribute("aria-label", mark.label);
    }
    if (mark.color) element.style.setProperty("--own", mark.color);
    if (mark.press) element.onclick = mark.press;
  }
}

function move(element: HTMLElement, at: readonly [number, number] | null): void {
  const visibility = at ? "visible" : "hidden";
  if (element.style.visibility !== visibility) element.style.visibility = visibility;
  if (at) element.style.transform = `translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px)`;
}
