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
  type WebGLRenderer,
} from "three";

import type { Payload } from "../protocol/frames";
import type { MaterialEntry, MeshMessage } from "../protocol/messages";
import type { Look } from "../store/state";
import { IDENTITY, type Vec3 } from "./affine";
import type { Scene } from "./columns";
import { Faces } from "./faces";
import { PosePass } from "./pose_pass";
import { PoseTextures } from "./pose_textures";
import { define, material } from "./shaders";

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
  private readonly materials: ShaderMaterial[];
  private look: Look = "texture";
  private heats = false;
  /** Counts the shapes that it has had: what is picked stays as long as neither this nor the camera changes. */
  shapes = 0;
  private wires: Mesh | null = null;
  private readonly textures: Texture[] = [];

  constructor(
    readonly message: MeshMessage,
    payload: Payload,
    renderer: WebGLRenderer,
    private readonly changed: () => void,
  ) {
    this.positions = payload.get("positions", "float32");
    this.vertexOf = payload.get("vertex", "uint32");
    const triangles = payload.get("triangles", "uint32");
    this.pose = new PoseTextures(message.vertices);
    const rows = { positions: this.positions, normals: payload.get("normals", "int16"), vertexOf: this.vertexOf };
    this.posed = new PosePass(renderer, rows, this.pose);
    const { geometry } = this;
    const { position, normal, rest } = this.posed;
    // By the first, three.js counts rows.
    Object.assign(geometry.attributes, { position, posedPosition: position, posedNormal: normal, rest });
    geometry.setIndex(new BufferAttribute(triangles, 1));
    if (payload.has("uv")) geometry.setAttribute("uv", new BufferAttribute(payload.get("uv", "float32"), 2));
    if (payload.has("colors")) {
      geometry.setAttribute("rowColor", new BufferAttribute(payload.get("colors", "uint8"), 4, true));
    }
    this.radius = Math.max(message.diagonal / 2, 1e-9);
    // Posed shapes leave their box: nothing is culled.
    geometry.boundingSphere = new Sphere(new Vector3(), this.radius);
    this.faces = new Faces(this.positions, triangles);
    this.shared = {
      lookColor: { value: new Color(0.62, 0.61, 0.6) },
      ownLook: { value: true },
      heatStrength: { value: 1 },
      heatAlone: { value: false },
    };
    this.materials = message.materials.map((entry) => this.material(entry, payload));
    for (const { start, count, material } of message.groups) geometry.addGroup(3 * start, 3 * count, material);
    this.surface = new Mesh(geometry, this.materials);
    this.surface.frustumCulled = false;
    this.group.add(this.surface);
  }

  show(scene: Scene): void {
    const rested = rests(this.pose.scene);
    this.pose.show(scene);
    if (!rested || !rests(scene)) this.shapes++;
    this.posed.invalidate();
    this.heats = scene.columns.some((column) => column.heat !== 0);
    this.compile();
  }

  setLook(look: Look, heatStrength: number): void {
    this.look = look;
    this.shared.ownLook.value = look === "texture";
    this.shared.heatAlone.value = look === "heat";
    this.shared.heatStrength.value = heatStrength;
    this.compile();
  }

  setClay(color: Color): void {
    (this.shared.lookColor.value as Color).copy(color);
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
    this.compile();
  }

  /** Show what the server posed: (V, 3) positions and (V, 4) normals; null lets the shader pose again. */
  setGiven(given: { positions: Float32Array; normals: Int16Array } | null): void {
    this.useGiven(true);
    if (!given) {
      this.posed.setGiven(null);
      return;
    }
    this.shapes++;
    const positions = new Float32Array(3 * this.vertexOf.length);
    const normals = new Int16Array(4 * this.vertexOf.length);
    this.vertexOf.forEach((vertex, row) => {
      for (let i = 0; i < 3; i++) {
        positions[3 * row + i] = given.positions[3 * vertex + i];
        normals[4 * row + i] = given.normals[4 * vertex + i];
      }
    });
    this.posed.setGiven({ positions, normals });
  }

  /** Whether to show what the server posed, where there is something. */
  useGiven(on: boolean): void {
    if (this.posed.useGiven(on)) this.shapes++;
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

  /** Have the materials do what is seen now, and no more. */
  private compile(): void {
    const { geometry, look, heats } = this;
    const features = look === "features" && geometry.hasAttribute("featureColor");
    const colors = look === "texture" && geometry.hasAttribute("rowColor");
    const heat = look === "heat" || (look !== "features" && heats);
    for (const each of this.materials) {
      const map = look === "texture" && each.uniforms.map.value !== null;
      define(
        each,
        Object.entries({ FEATURES: features, COLORS: colors, MAP: map, HEAT: heat }).flatMap(([name, on]) =>
          on ? [name] : [],
        ),
      );
    }
  }

  private material(entry: MaterialEntry, payload: Payload): ShaderMaterial {
    const [red, green, blue, alpha] = entry.color;
    const cutoff = entry.alpha_mode === "MASK" ? entry.alpha_cutoff : 0;
    const uniforms: Record<string, IUniform> = {
      ...this.shared,
      baseColor: { value: new Color().setRGB(red, green, blue, SRGBColorSpace) },
      map: { value: null },
      opacity: { value: alpha },
      blends: { value: entry.alpha_mode === "BLEND" },
      cutoff: { value: cutoff },
    };
    if (entry.texture) void this.picture(entry, payload.get(entry.texture, "uint8"), uniforms);
    return material("surface", uniforms, {
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
      baseColor: { value: color.clone() },
      opacity: { value: opacity },
    };
    return material("surface", uniforms, {
      defines: { FLAT: "" },
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
      this.compile();
      this.changed();
    } catch {
      // A picture that this browser cannot read leaves the plain color.
    }
  }
}

/** Whether nothing moves. */
function rests({ columns, defaultTransform }: Scene): boolean {
  return defaultTransform === null && columns.every(({ transform }) => transform.every((x, i) => x === IDENTITY[i]));
}
