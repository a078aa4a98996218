/** What the pose shader reads: distances in layers of an integer texture, and a row of numbers per column. */

import {
  DataArrayTexture,
  DataTexture,
  FloatType,
  Matrix4,
  NearestFilter,
  RGBAFormat,
  RGIntegerFormat,
  UnsignedShortType,
  Vector4,
  type IUniform,
} from "three";

import { IDENTITY, type Affine } from "./affine";
import { FALLOFFS, type Layer, type Scene } from "./columns";
import { mirrored } from "./twin";

const WIDTH = 4096;
const TEXELS = 10;
const LEAST_LAYERS = 4;
const LEAST_ROWS = 16;

export interface PoseUniforms extends Record<string, IUniform> {
  distances: IUniform<DataArrayTexture>;
  columns: IUniform<DataTexture>;
  columnCount: IUniform<number>;
  hasDefault: IUniform<boolean>;
  defaultTransform: IUniform<Matrix4>;
  mirror: IUniform<Vector4>;
  mirrorBand: IUniform<number>;
  given: IUniform<boolean>;
}

export class PoseTextures {
  readonly uniforms: PoseUniforms;
  private readonly height: number;
  private readonly places = new Map<Layer, number>();

  constructor(vertexCount: number) {
    this.height = Math.max(Math.ceil(vertexCount / WIDTH), 1);
    this.uniforms = {
      distances: { value: this.layers(LEAST_LAYERS) },
      columns: { value: rows(LEAST_ROWS) },
      columnCount: { value: 0 },
      hasDefault: { value: false },
      defaultTransform: { value: new Matrix4() },
      mirror: { value: new Vector4(1, 0, 0, 0) },
      mirrorBand: { value: -1 },
      given: { value: false },
    };
  }

  /** Have the shader pose by `scene`; distances go to the GPU once, when they are first seen. */
  show(scene: Scene): void {
    this.keep(scene);
    const { uniforms } = this;
    const count = scene.columns.length;
    if (count > uniforms.columns.value.image.height) {
      uniforms.columns.value.dispose();
      uniforms.columns.value = rows(2 * count);
    }
    const table = uniforms.columns.value.image.data as Float32Array;
    scene.columns.forEach((column, k) => {
      const at = 4 * TEXELS * k;
      writeMove(table, at, column.transform);
      writeMove(table, at + 12, scene.mirror ? mirrored(column.transform, scene.mirror) : column.transform);
      table.set([column.reach, FALLOFFS.indexOf(column.falloff), column.exponent, column.gain], at + 24);
      const places = [column.layer, column.fixed, column.share].map((layer) => this.place(layer));
      table.set([...places, column.positive ? 1 : -1], at + 28);
      const isWeight = column.layer.kind === "weight" ? 1 : 0;
      table.set([column.layer.scale, isWeight, column.fixed?.scale ?? 0, column.strength], at + 32);
      table.set([column.heat, column.acts ? 1 : 0, column.shareGain, 0], at + 36);
    });
    uniforms.columns.value.needsUpdate = true;
    uniforms.columnCount.value = count;
    uniforms.hasDefault.value = scene.defaultTransform !== null;
    if (scene.defaultTransform) uniforms.defaultTransform.value.copy(matrix4(scene.defaultTransform));
    uniforms.mirrorBand.value = scene.mirror ? scene.mirror.band : -1;
    if (scene.mirror) uniforms.mirror.value.set(...scene.mirror.normal, scene.mirror.offset);
  }

  dispose(): void {
    this.uniforms.distances.value.dispose();
    this.uniforms.columns.value.dispose();
  }

  private place(layer: Layer | null): number {
    return layer ? (this.places.get(layer) ?? -1) : -1;
  }

  private keep(scene: Scene): void {
    const wanted = new Set<Layer>();
    for (const { layer: own, fixed, share } of scene.columns) {
      for (const layer of [own, fixed, share]) if (layer) wanted.add(layer);
    }
    for (const layer of this.places.keys()) if (!wanted.has(layer)) this.places.delete(layer);
    const fresh = [...wanted].filter((layer) => !this.places.has(layer));
    if (fresh.length === 0) return;
    const capacity = this.uniforms.distances.value.image.depth;
    if (wanted.size > capacity) {
      this.uniforms.distances.value.dispose();
      this.uniforms.distances.value = this.layers(2 * wanted.size);
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

  private write(layer: Layer, place: number): void {
    const texture = this.uniforms.distances.value;
    const data = texture.image.data as Uint16Array;
    const start = 2 * WIDTH * this.height * place;
    const { values, geodesic } = layer;
    for (let i = 0; i < values.length; i++) {
      data[start + 2 * i] = values[i];
      data[start + 2 * i + 1] = geodesic ? geodesic[i] : 0;
    }
    texture.addLayerUpdate(place);
    texture.needsUpdate = true;
  }

  private layers(count: number): DataArrayTexture {
    const data = new Uint16Array(2 * WIDTH * this.height * count);
    const texture = new DataArrayTexture(data, WIDTH, this.height, count);
    texture.format = RGIntegerFormat;
    texture.type = UnsignedShortType;
    texture.internalFormat = "RG16UI";
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

/** D − I: what is added to a point, which keeps its digits where little moves. */
function writeMove(table: Float32Array, at: number, transform: Affine): void {
  for (let i = 0; i < 12; i++) table[at + i] = transform[i] - IDENTITY[i];
}

export function matrix4(a: Affine): Matrix4 {
  return new Matrix4().set(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11], 0, 0, 0, 1);
}
