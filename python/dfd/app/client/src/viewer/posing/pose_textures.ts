/** The input of the pose shader: weights as layers of an integer texture, and one row of numbers per column. */

import {
  DataArrayTexture,
  DataTexture,
  FloatType,
  NearestFilter,
  RGBAFormat,
  RedIntegerFormat,
  UnsignedShortType,
  type Matrix4,
  type Texture,
} from "three";

import { IDENTITY } from "../../posing/affine";
import { EMPTY_SCENE, mirrored, type Scene } from "../../posing/columns";

const WIDTH = 4096;
const TEXELS = 7;
const LEAST_LAYERS = 4;
const LEAST_ROWS = 16;
/** The elements of the linear part of an affine matrix. */
const LINEAR = [0, 1, 2, 4, 5, 6, 8, 9, 10];

export class PoseTextures {
  weights: DataArrayTexture;
  columns = rows(LEAST_ROWS);
  columnCount = 0;
  /** The parts of the shader that the scene needs. */
  defines: readonly string[] = [];
  scene: Scene = EMPTY_SCENE;
  private readonly height: number;
  private readonly places = new Map<Uint16Array, number>();

  constructor(vertexCount: number) {
    this.height = Math.max(Math.ceil(vertexCount / WIDTH), 1);
    this.weights = this.layers(LEAST_LAYERS);
  }

  /** Set the scene of the shader; each column of weights is uploaded once. */
  show(scene: Scene): void {
    this.keep(scene);
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
      const layer = this.places.get(column.weights) ?? -1;
      table.set([layer, column.positive ? 1 : -1, column.heat, column.handle > 0 ? 1 : 0], at + 24);
    });
    this.columns.needsUpdate = true;
    this.columnCount = count;
    this.scene = scene;
    this.defines = definesOf(scene);
  }

  get textures(): readonly Texture[] {
    return [this.weights, this.columns];
  }

  dispose(): void {
    this.textures.forEach((texture) => texture.dispose());
  }

  private keep(scene: Scene): void {
    const wanted = new Set(scene.columns.map(({ weights }) => weights));
    for (const layer of this.places.keys()) if (!wanted.has(layer)) this.places.delete(layer);
    const fresh = [...wanted].filter((layer) => !this.places.has(layer));
    if (fresh.length === 0) return;
    const capacity = this.weights.image.depth;
    if (wanted.size > capacity) {
      this.weights.dispose();
      this.weights = this.layers(2 * wanted.size);
      this.places.clear();
      fresh.splice(0, fresh.length, ...wanted);
    }
    const taken = new Set(this.places.values());
    let next = 0;
    for (const layer of fresh) {
      while (taken.has(next)) next++;
      taken.add(next);
      this.places.set(layer, next);
      this.write(layer, next);
    }
  }

  private write(layer: Uint16Array, place: number): void {
    const texture = this.weights;
    (texture.image.data as Uint16Array).set(layer, WIDTH * this.height * place);
    texture.addLayerUpdate(place);
    texture.needsUpdate = true;
  }

  private layers(count: number): DataArrayTexture {
    const data = new Uint16Array(WIDTH * this.height * count);
    const texture = new DataArrayTexture(data, WIDTH, this.height, count);
    texture.format = RedIntegerFormat;
    texture.type = UnsignedShortType;
    texture.internalFormat = "R16UI";
    texture.minFilter = texture.magFilter = NearestFilter;
    texture.unpackAlignment = 4;
    texture.needsUpdate = true;
    return texture;
  }
}

function rows(count: number): DataTexture {
  const texture = new DataTexture(new Float32Array(4 * TEXELS * count), TEXELS, count, RGBAFormat, FloatType);
  texture.needsUpdate = true;
  return texture;
}

function definesOf({ columns, mirror, defaultTransform }: Scene): string[] {
  const turns = ({ elements }: Matrix4) => LINEAR.some((i) => elements[i] !== IDENTITY.elements[i]);
  const has = { MIRROR: mirror, DEFAULT: defaultTransform, TURNED: columns.some(({ transform }) => turns(transform)) };
  return Object.entries(has).flatMap(([name, part]) => (part ? [name] : []));
}

/** Rows of D − I. Adding displacements to a point keeps precision where the motion is small. */
function writeMove(table: Float32Array, at: number, { elements }: Matrix4): void {
  for (let i = 0; i < 12; i++) {
    const k = 4 * (i % 4) + Math.floor(i / 4);
    table[at + i] = elements[k] - IDENTITY.elements[k];
  }
}
