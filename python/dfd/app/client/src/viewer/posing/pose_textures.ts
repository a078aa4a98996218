/** The textures of the pose shader. Each `Column` of the scene, usually a handle at one counterpart, has a row of
    `columns`. The row contains the index of the layer in `weights`. Columns with the same weights share a layer. */

import * as THREE from "three";

import { IDENTITY } from "../../posing/affine";
import { EMPTY_SCENE, mirrored, type Scene } from "../../posing/columns";

export const WIDTH = 4096; // texels per row of `weights`
const TEXELS = 7; // texels per row of `columns`
const LEAST_LAYERS = 4;
const LEAST_ROWS = 16;
const LINEAR = [0, 1, 2, 4, 5, 6, 8, 9, 10]; // indices of the linear part in the elements of an affine matrix

export class PoseTextures {
  weights: THREE.DataArrayTexture;
  columns = rows(LEAST_ROWS);
  scene: Scene = EMPTY_SCENE;
  private readonly height: number;
  /** The weights that each layer contains; null for an unused layer. */
  private stored = empty(LEAST_LAYERS);

  constructor(vertexCount: number) {
    this.height = Math.max(Math.ceil(vertexCount / WIDTH), 1);
    this.weights = this.layers(LEAST_LAYERS);
  }

  show(scene: Scene): void {
    this.storeWeights(scene);
    const count = scene.columns.length;
    if (count > this.columns.image.height) {
      this.columns.dispose();
      this.columns = rows(2 * count);
    }
    const table = this.columns.image.data as Float32Array;
    scene.columns.forEach((column, k) => {
      const at = 4 * TEXELS * k;
      writeMove(table, at, column.transform);
      writeMove(table, at + 12, scene.mirror ? mirrored(column.transform, scene.mirror) : column.transform);
      const layer = this.stored.indexOf(column.weights);
      table.set([layer, column.positive ? 1 : -1, column.heat, column.handle > 0 ? 1 : 0], at + 24);
    });
    this.columns.needsUpdate = true;
    this.scene = scene;
  }

  dispose(): void {
    this.weights.dispose();
    this.columns.dispose();
  }

  /** Write the weights of each column to a layer, unless a layer contains them already. */
  private storeWeights(scene: Scene): void {
    const wanted = new Set(scene.columns.map(({ weights }) => weights));
    if (wanted.size > this.stored.length) {
      this.weights.dispose();
      this.weights = this.layers(2 * wanted.size);
      this.stored = empty(2 * wanted.size);
    }
    this.stored = this.stored.map((kept) => (kept && wanted.has(kept) ? kept : null));
    for (const weights of wanted) {
      if (this.stored.includes(weights)) continue;
      const place = this.stored.indexOf(null);
      this.stored[place] = weights;
      (this.weights.image.data as Uint16Array).set(weights, WIDTH * this.height * place);
      this.weights.addLayerUpdate(place);
      this.weights.needsUpdate = true;
    }
  }

  private layers(count: number): THREE.DataArrayTexture {
    const data = new Uint16Array(WIDTH * this.height * count);
    const texture = new THREE.DataArrayTexture(data, WIDTH, this.height, count);
    texture.format = THREE.RedIntegerFormat;
    texture.type = THREE.UnsignedShortType;
    texture.internalFormat = "R16UI";
    texture.minFilter = texture.magFilter = THREE.NearestFilter;
    texture.unpackAlignment = 4;
    texture.needsUpdate = true;
    return texture;
  }
}

function empty(count: number): (Uint16Array | null)[] {
  return new Array<Uint16Array | null>(count).fill(null);
}

function rows(count: number): THREE.DataTexture {
  const texture = new THREE.DataTexture(
    new Float32Array(4 * TEXELS * count),
    TEXELS,
    count,
    THREE.RGBAFormat,
    THREE.FloatType,
  );
  texture.needsUpdate = true;
  return texture;
}

/** Return which names must be defined in the shader for a scene. */
export function definesOf({ columns, mirror, defaultTransform }: Scene): Record<string, boolean> {
  const turns = ({ elements }: THREE.Matrix4) => LINEAR.some((i) => elements[i] !== IDENTITY.elements[i]);
  const turned = columns.some(({ transform }) => turns(transform));
  return { MIRROR: mirror !== null, DEFAULT: defaultTransform !== null, TURNED: turned };
}

/** Write the rows of a transform minus the identity. The shader adds displacements, so small motions stay precise. */
function writeMove(table: Float32Array, at: number, { elements }: THREE.Matrix4): void {
  for (let i = 0; i < 12; i++) {
    const k = 4 * (i % 4) + Math.floor(i / 4);
    table[at + i] = elements[k] - IDENTITY.elements[k];
  }
}
