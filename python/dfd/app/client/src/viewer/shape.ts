/** The mesh on the GPU: geometry, its materials in their looks, and what poses it. */

import {
  BufferAttribute,
  BufferGeometry,
  ClampToEdgeWrapping,
  Color,
  CustomBlending,
  FrontSide,
  DoubleSide,
  Group,
  IntType,
  LinearFilter,
  LinearMipmapLinearFilter,
  Mesh,
  MirroredRepeatWrapping,
  OneFactor,
  OneMinusSrcAlphaFactor,
  RepeatWrapping,
  SRGBColorSpace,
  Sphere,
  Texture,
  Vector3,
  type IUniform,
  type ShaderMaterial,
} from "three";

import type { Payload } from "../protocol/frames";
import type { MaterialEntry, MeshMessage } from "../protocol/messages";
import type { Look } from "../store/state";
import type { Vec3 } from "./affine";
import type { Scene } from "./columns";
import { Faces } from "./faces";
import { PosePass } from "./pose_pass";
import { PoseTextures } from "./pose_textures";
import { poseMaterial } from "./shaders";

const LOOKS: readonly Look[] = ["texture", "clay", "features", "heat"];
const WRAPS = { repeat: RepeatWrapping, mirror: MirroredRepeatWrapping, clamp: ClampToEdgeWrapping } as const;

export class Shape {
  readonly group = new Group();
  readonly geometry = new BufferGeometry();
  readonly posed: PosePass;
  readonly faces: Faces;
  readonly radius: number;
  /** (R, 3) at rest, relative to the mesh's center. */
  readonly positions: Float32Array;
  /** (R) the vertex of each row. */
  readonly vertexOf: Uint32Array;
  private readonly pose: PoseTextures;
  private readonly shared: Record<string, IUniform>;
  private readonly surface: Mesh;
  private hasGiven = false;
  private wires: Mesh | null = null;
  private readonly textures: Texture[] = [];

  constructor(
    readonly message: MeshMessage,
    payload: Payload,
    private readonly changed: () => void,
  ) {
    this.positions = payload.get("positions", "float32");
    this.vertexOf = payload.get("vertex", "uint32");
    const triangles = payload.get("triangles", "uint32");
    const { geometry } = this;
    geometry.setAttribute("position", new BufferAttribute(this.positions, 3));
    geometry.setAttribute("normal", new BufferAttribute(payload.get("normals", "int16"), 4, true));
    geometry.setAttribute("vertex", integers(this.vertexOf));
    geometry.setIndex(new BufferAttribute(triangles, 1));
    if (payload.has("uv")) geometry.setAttribute("uv", new BufferAttribute(payload.get("uv", "float32"), 2));
    const hasColors = payload.has("colors");
    if (hasColors) geometry.setAttribute("rowColor", new BufferAttribute(payload.get("colors", "uint8"), 4, true));
    this.radius = Math.max(message.diagonal / 2, 1e-9);
    // Posed shapes leave their box: nothing is culled.
    geometry.boundingSphere = new Sphere(new Vector3(), this.radius);
    this.faces = new Faces(this.positions, triangles);
    this.pose = new PoseTextures(message.vertices);
    this.posed = new PosePass(geometry, this.vertexOf.length, this.pose.uniforms);
    this.shared = {
      ...this.posed.uniforms,
      look: { value: 0 },
      clay: { value: new Color(0.62, 0.61, 0.6) },
      heatStrength: { value: 1 },
      hasColors: { value: hasColors },
      hasFeatures: { value: false },
    };
    const materials = message.materials.map((entry) => this.material(entry, payload));
    for (const { start, count, material } of message.groups) geometry.addGroup(3 * start, 3 * count, material);
    this.surface = new Mesh(geometry, materials);
    this.surface.frustumCulled = false;
    this.group.add(this.surface);
  }

  show(scene: Scene): void {
    this.pose.show(scene);
    this.posed.invalidate();
  }

  setLook(look: Look, heatStrength: number): void {
    this.shared.look.value = LOOKS.indexOf(look);
    this.shared.heatStrength.value = heatStrength;
  }

  setClay(color: Color): void {
    (this.shared.clay.value as Color).copy(color);
  }

  setWireframe(on: boolean, color: Color, opacity: number): void {
    if (on && !this.wires) {
      const material = this.flat(color, opacity);
      this.wires = new Mesh(this.geometry, material);
      this.wires.frustumCulled = false;
      this.group.add(this.wires);
    }
    if (!this.wires) return;
    this.wires.visible = on;
    const { uniforms } = this.wires.material as ShaderMaterial;
    (uniforms.baseColor.value as Color).copy(color);
    uniforms.opacity.value = opacity;
  }

  /** (V, 4) colors of the features' main directions. */
  setFeatureColors(colors: Uint8Array): void {
    const rows = new Uint8Array(4 * this.vertexOf.length);
    this.vertexOf.forEach((vertex, row) => {
      for (let i = 0; i < 4; i++) rows[4 * row + i] = colors[4 * vertex + i];
    });
    this.geometry.setAttribute("featureColor", new BufferAttribute(rows, 4, true));
    this.shared.hasFeatures.value = true;
  }

  /** Show what the server posed: (V, 3) positions and (V, 4) normals; null lets the shader pose again. */
  setGiven(given: { positions: Float32Array; normals: Int16Array } | null): void {
    this.hasGiven = given !== null;
    this.useGiven(true);
    if (!given) return;
    const positions = new Float32Array(3 * this.vertexOf.length);
    const normals = new Int16Array(4 * this.vertexOf.length);
    this.vertexOf.forEach((vertex, row) => {
      for (let i = 0; i < 3; i++) {
        positions[3 * row + i] = given.positions[3 * vertex + i];
        normals[4 * row + i] = given.normals[4 * vertex + i];
      }
    });
    this.geometry.setAttribute("givenPosition", new BufferAttribute(positions, 3));
    this.geometry.setAttribute("givenNormal", new BufferAttribute(normals, 4, true));
    this.posed.invalidate();
  }

  /** Whether to show what the server posed, where there is something. */
  useGiven(on: boolean): void {
    this.pose.uniforms.given.value = on && this.hasGiven;
    this.posed.invalidate();
  }

  /** Where a row of the mesh rests. */
  at(row: number): Vec3 {
    return [this.positions[3 * row], this.positions[3 * row + 1], this.positions[3 * row + 2]];
  }

  dispose(): void {
    this.geometry.dispose();
    this.pose.dispose();
    this.posed.dispose();
    for (const texture of this.textures) {
      (texture.image as ImageBitmap | null)?.close();
      texture.dispose();
    }
    const materials = [this.surface.material, this.wires?.material ?? []].flat();
    for (const material of materials) material.dispose();
    this.group.removeFromParent();
  }

  private material(entry: MaterialEntry, payload: Payload): ShaderMaterial {
    const [red, green, blue, alpha] = entry.color;
    const cutoff = entry.alpha_mode === "MASK" ? entry.alpha_cutoff : 0;
    const uniforms: Record<string, IUniform> = {
      ...this.shared,
      baseColor: { value: new Color().setRGB(red, green, blue, SRGBColorSpace) },
      hasMap: { value: false },
      map: { value: null },
      opacity: { value: alpha },
      blends: { value: entry.alpha_mode === "BLEND" },
      cutoff: { value: cutoff },
      flatColor: { value: false },
    };
    if (entry.texture) void this.picture(entry, payload.get(entry.texture, "uint8"), uniforms);
    return poseMaterial("surface", uniforms, {
      side: DoubleSide,
      transparent: entry.alpha_mode === "BLEND",
      // Wires lie on the surface, not in it.
      polygonOffset: true,
      polygonOffsetFactor: 1,
      polygonOffsetUnits: 1,
    });
  }

  private flat(color: Color, opacity: number): ShaderMaterial {
    const uniforms: Record<string, IUniform> = {
      ...this.shared,
      baseColor: { value: color.clone() },
      hasMap: { value: false },
      map: { value: null },
      opacity: { value: opacity },
      blends: { value: true },
      cutoff: { value: 0 },
      flatColor: { value: true },
    };
    return poseMaterial("surface", uniforms, {
      wireframe: true,
      transparent: true,
      depthWrite: false,
      side: FrontSide,
      blending: CustomBlending,
      blendSrc: OneFactor,
      blendDst: OneMinusSrcAlphaFactor,
    });
  }

  private async picture(entry: MaterialEntry, file: Uint8Array, uniforms: Record<string, IUniform>): Promise<void> {
    const blob = new Blob([file.slice()], { type: entry.media_type ?? "image/png" });
    try {
      // The protocol's v points upwards, as OpenGL's does: the first row of texels is the picture's lowest.
      const image = await createImageBitmap(blob, { imageOrientation: "flipY", premultiplyAlpha: "none" });
      const texture = new Texture(image);
      texture.flipY = false;
      texture.colorSpace = SRGBColorSpace;
      texture.wrapS = WRAPS[entry.wrap[0]];
      texture.wrapT = WRAPS[entry.wrap[1]];
      texture.magFilter = LinearFilter;
      texture.minFilter = LinearMipmapLinearFilter;
      texture.anisotropy = 4;
      texture.needsUpdate = true;
      this.textures.push(texture);
      uniforms.map.value = texture;
      uniforms.hasMap.value = true;
      this.changed();
    } catch {
      // A picture that this browser cannot read leaves the plain color.
    }
  }
}

function integers(values: Uint32Array): BufferAttribute {
  const attribute = new BufferAttribute(values, 1);
  attribute.gpuType = IntType;
  return attribute;
}
