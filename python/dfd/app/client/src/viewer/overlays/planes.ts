/** Symmetry planes: the one in use, and dimly those that were found. */

import { Color, Group, Line, Mesh, Plane, PlaneHelper, Vector3, type Material } from "three";

import type { Mirror } from "../../posing/columns";

export class Planes {
  readonly group = new Group();
  private helpers: PlaneHelper[] = [];

  show(planes: readonly { readonly mirror: Mirror; readonly used: boolean }[], radius: number, color: Color): void {
    for (const helper of this.helpers) helper.dispose();
    this.group.clear();
    this.helpers = planes.map(({ mirror, used }) => {
      const plane = new Plane(new Vector3(...mirror.normal), -mirror.offset);
      const helper = new PlaneHelper(plane, 1.3 * radius, color.getHex());
      helper.traverse((drawn) => {
        if (!(drawn instanceof Line || drawn instanceof Mesh)) return;
        const material = drawn.material as Material;
        material.transparent = true;
        material.opacity = (used ? 1 : 0.5) * (drawn instanceof Mesh ? 0.1 : 0.6);
      });
      return helper;
    });
    for (const helper of this.helpers) this.group.add(helper);
  }
}
