/** What lies behind the shape, drawn with it: browsers lay an opaque canvas over the page at half the cost of a clear one. */

import { BufferAttribute, BufferGeometry, Color, Mesh } from "three";

import { material } from "../posing/shaders";

export class Background {
  readonly mesh: Mesh;
  private readonly middle = { value: new Color() };
  private readonly rim = { value: new Color() };

  constructor() {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(9), 3));
    const uniforms = { middle: this.middle, rim: this.rim };
    this.mesh = new Mesh(geometry, material("background", uniforms, { depthWrite: false }));
    this.mesh.frustumCulled = false;
    // After all that hides it, before all that lets it shine through.
    this.mesh.renderOrder = 1;
  }

  /** From the middle of the view to its corners. */
  dress(middle: string, rim: string): void {
    this.middle.value.setStyle(middle).convertLinearToSRGB();
    this.rim.value.setStyle(rim).convertLinearToSRGB();
  }
}
