/** Symmetry planes: the one in use, and dimly those that were found. */

import {
  BufferGeometry,
  Color,
  DoubleSide,
  Group,
  Line,
  LineBasicMaterial,
  LineLoop,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  Quaternion,
  Vector3,
  type Material,
} from "three";

import type { Mirror } from "../../posing/columns";

const CORNERS = [-0.5, -0.5, 0.5, -0.5, 0.5, 0.5, -0.5, 0.5];

export class Planes {
  readonly group = new Group();
  private readonly face = new PlaneGeometry(1, 1);
  private readonly edge = new BufferGeometry().setFromPoints(
    [0, 2, 4, 6].map((i) => new Vector3(CORNERS[i], CORNERS[i + 1], 0)),
  );

  show(planes: readonly { readonly mirror: Mirror; readonly used: boolean }[], radius: number, color: Color): void {
    for (const child of [...this.group.children]) {
      child.traverse((part) => {
        if (part instanceof Mesh || part instanceof Line) (part.material as Material).dispose();
      });
      child.removeFromParent();
    }
    for (const { mirror, used } of planes) {
      const fill = new MeshBasicMaterial({
        color,
        transparent: true,
        opacity: used ? 0.1 : 0.05,
        side: DoubleSide,
        depthWrite: false,
      });
      const line = new LineBasicMaterial({ color, transparent: true, opacity: used ? 0.8 : 0.4 });
      const plane = new Group().add(new Mesh(this.face, fill), new LineLoop(this.edge, line));
      const normal = new Vector3(...mirror.normal);
      plane.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), normal));
      plane.position.copy(normal.multiplyScalar(mirror.offset));
      plane.scale.setScalar(1.3 * radius);
      plane.renderOrder = 2;
      this.group.add(plane);
    }
  }
}
