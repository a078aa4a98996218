/** The mesh on the GPU: geometry, its materials in their revision, and what poses it. */

import {
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
  Texture,
  type BufferGeometry,
  type IUniform,
  type ShaderMaterial,
  type WebGLRenderer,
} from "three";

import { IDENTITY, type Vec3 } from "../posing/affine";
import { sameScene, type Scene } from "../posing/columns";
import type { Payload } from "../protocol/binary_messages";
import type { DetailMessage, MaterialEntry, MeshMessage } from "../protocol/messages";
import type { Level, Look, Posed } from "../store/state";
import { Levels, type Drawn, type Triangles } from "./posing/levels";
import { PoseTextures } from "./posing/pose_textures";
import { define, material } from "./posing/shaders";
import { SHAPE_LAYER, type Drawable } from "./still";

const WRAPS = { repeat: RepeatWrapping, mirror: MirroredRepeatWrapping, clamp: ClampToEdgeWrapping } as const;

export class Shape {
  readonly group = new Group();
  readonly radius: number;
  private levels: Levels;
  private level: Level = "full";
  private readonly first: Triangles;
  private readonly pose: PoseTextures;
  private readonly shared: Record<string, IUniform>;
  private readonly surface: Mesh;
  private readonly materials: ShaderMaterial[];
  private look: Look = "texture";
  /** Whether only what is warm in the heat map is seen. */
  isolated = false;
  private heats = false;
  /** Counts its poses: what is picked stays as long as neither this nor the camera changes. */
  poses = 0;
  /** Counts changes of what it looks like. */
  revision = 0;
  private wires: Mesh | null = null;
  private readonly textures: Texture[] = [];
  private featureColors: Uint8Array | null = null;
  private given: Posed | null = null;

  constructor(
    readonly message: MeshMessage,
    payload: Payload,
    private readonly renderer: WebGLRenderer,
    private readonly changed: () => void,
  ) {
    this.radius = Math.max(message.diagonal / 2, 1e-9);
    this.pose = new PoseTextures(message.vertices);
    this.first = { corners: payload.get("triangles", "uint32"), groups: message.groups };
    const levels = message.coarse ? { coarse: this.first } : { full: this.first };
    this.levels = new Levels(renderer, this.pose, payload, levels, this.radius);
    this.shared = {
      lookColor: { value: new Color(0.62, 0.61, 0.6) },
      ownLook: { value: true },
      heatStrength: { value: 1 },
      heatAlone: { value: false },
      fade: { value: 1 },
    };
    this.materials = message.materials.map((entry) => this.material(entry, payload));
    this.surface = new Mesh(this.drawn.geometry, this.materials);
    this.surface.frustumCulled = false;
    this.surface.layers.set(SHAPE_LAYER);
    this.group.add(this.surface);
  }

  /** The whole of a shape of which only the coarse level had come. */
  detail(message: DetailMessage, payload: Payload): void {
    if (this.levels.has("full")) return;
    const full = { corners: payload.get("triangles", "uint32"), groups: message.groups };
    const before = this.levels;
    this.levels = new Levels(this.renderer, this.pose, payload, { coarse: this.first, full }, this.radius);
    if (this.featureColors) this.levels.setFeatureColors(this.featureColors);
    this.levels.posed.useGiven(before.posed.usesGiven);
    this.levels.setPosed(this.given);
    this.use(this.level);
    this.poses++;
    this.revision++;
    before.dispose();
  }

  /** (R, 3) at rest, relative to the mesh's center. */
  get positions(): Float32Array {
    return this.levels.positions;
  }

  /** (R) the vertex of each row. */
  get vertexOf(): Uint32Array {
    return this.levels.vertexOf;
  }

  /** What is seen: whole or coarse. */
  get drawn(): Drawn {
    return this.levels.of(this.level);
  }

  /** Whether there are both levels. */
  get hasLevels(): boolean {
    return this.levels.has("coarse") && this.levels.has("full");
  }

  /** The level that is seen. */
  get shown(): Level {
    return this.levels.has(this.level) ? this.level : "coarse";
  }

  /** Whether nothing shines through it. */
  get opaque(): boolean {
    return this.materials.every((each) => !each.transparent);
  }

  /** Whether all of it has come. */
  get whole(): boolean {
    return this.levels.has("full");
  }

  /** Show a level, as soon as it is there. */
  use(level: Level): void {
    this.level = level;
    const { geometry } = this.drawn;
    if (this.surface.geometry === geometry) return;
    this.poses++;
    this.wear(geometry);
  }

  private wear(geometry: BufferGeometry): void {
    this.surface.geometry = geometry;
    if (this.wires) this.wires.geometry = geometry;
  }

  /** Have posed what is seen. */
  update(): void {
    this.levels.posed.update(this.drawn.rows);
  }

  get drawable(): Drawable {
    const { geometry, rows, faces } = this.levels.of("full");
    return {
      rows,
      faces: faces.count,
      pose: (count) => this.levels.posed.update(count),
      among: (first, count, draw) => {
        const seen = this.surface.geometry;
        this.wear(geometry);
        geometry.setDrawRange(3 * first, 3 * count);
        draw();
        geometry.setDrawRange(0, Infinity);
        this.wear(seen);
      },
    };
  }

  /** (R, 4) posed positions and heat of the whole, read back. */
  read(): Float32Array {
    return this.levels.posed.read();
  }

  show(scene: Scene): void {
    if (sameScene(scene, this.pose.scene)) return;
    const rested = rests(this.pose.scene);
    this.pose.show(scene);
    if (!rested || !rests(scene)) this.poses++;
    this.levels.posed.invalidate();
    this.revision++;
    this.heats = scene.columns.some((column) => column.heat !== 0);
    this.compile();
  }

  setLook(look: Look, heatStrength: number): void {
    this.look = look;
    this.shared.ownLook.value = look === "texture";
    this.shared.heatAlone.value = look === "heat";
    this.shared.heatStrength.value = heatStrength;
    this.revision++;
    this.compile();
  }

  /** Have what lies behind shine through, and see nothing but what is held. */
  reveal(xray: boolean, isolated: boolean): void {
    this.shared.fade.value = xray ? 0.4 : 1;
    this.isolated = isolated;
    for (const each of this.materials) {
      each.transparent = xray || each.uniforms.blends.value === true;
      each.depthWrite = !xray;
    }
    this.poses++;
    this.revision++;
    this.compile();
  }

  setClay(color: Color): void {
    (this.shared.lookColor.value as Color).copy(color);
    this.revision++;
  }

  setWireframe(on: boolean, color: Color, opacity: number): void {
    if (on && !this.wires) {
      const material = this.flat(color, opacity);
      this.wires = new Mesh(this.drawn.geometry, material);
      this.wires.frustumCulled = false;
      this.wires.layers.set(SHAPE_LAYER);
      this.group.add(this.wires);
    }
    if (!this.wires) return;
    this.wires.visible = on;
    this.revision++;
    const { uniforms } = this.wires.material as ShaderMaterial;
    (uniforms.baseColor.value as Color).copy(color);
    uniforms.opacity.value = opacity;
  }

  /** (V, 4) colors of the features' main directions. */
  setFeatureColors(colors: Uint8Array): void {
    this.featureColors = colors;
    this.levels.setFeatureColors(colors);
    this.revision++;
    this.compile();
  }

  /** Show what the server posed: (V, 3) positions and (V, 4) normals; null lets the shader pose again. */
  setPosed(posed: Posed | null): void {
    this.usePosed(true);
    this.given = posed;
    if (posed) this.poses++;
    this.revision++;
    this.levels.setPosed(posed);
  }

  /** Whether to show what the server posed, where there is something. */
  usePosed(on: boolean): void {
    if (!this.levels.posed.useGiven(on)) return;
    this.poses++;
    this.revision++;
  }

  /** Where a row of the mesh rests. */
  at(row: number): Vec3 {
    return [this.positions[3 * row], this.positions[3 * row + 1], this.positions[3 * row + 2]];
  }

  dispose(): void {
    this.levels.dispose();
    this.pose.dispose();
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
    const { look, heats } = this;
    const { geometry } = this.drawn;
    const features = look === "features" && geometry.hasAttribute("featureColor");
    const colors = look === "texture" && geometry.hasAttribute("rowColor");
    const heat = look === "heat" || (look !== "features" && heats);
    for (const each of this.materials) {
      const map = look === "texture" && each.uniforms.map.value !== null;
      define(
        each,
        Object.entries({ FEATURES: features, COLORS: colors, MAP: map, HEAT: heat, ISOLATED: this.isolated }).flatMap(
          ([name, on]) => (on ? [name] : []),
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
      this.revision++;
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
