/** The mesh on the GPU: geometry, materials and pose. */

import {
  BufferAttribute,
  BufferGeometry,
  ClampToEdgeWrapping,
  Color,
  DoubleSide,
  Group,
  Mesh,
  MirroredRepeatWrapping,
  RepeatWrapping,
  Sphere,
  SRGBColorSpace,
  Texture,
  Vector3,
  type IUniform,
  type ShaderMaterial,
  type WebGLRenderer,
} from "three";

import type { Vec3 } from "../posing/affine";
import { sameScene, type Scene } from "../posing/columns";
import type { Payload } from "../protocol/binary_messages";
import type { MaterialEntry, MeshMessage } from "../protocol/messages";
import { isolates, type Look, type Posed, type State } from "../store/state";
import { Faces } from "./posing/faces";
import { PosePass } from "./posing/pose_pass";
import { PoseTextures } from "./posing/pose_textures";
import { define, material } from "./posing/shaders";

const WIRE = "#10182c";
/** Edges of at least this number of pixels are drawn at full strength; shorter edges are fainter. */
const LONG_EDGE = 14;
const WRAPS = { repeat: RepeatWrapping, mirror: MirroredRepeatWrapping, clamp: ClampToEdgeWrapping } as const;

export class Shape {
  readonly group = new Group();
  readonly radius: number;
  /** The resting position of each row, (R, 3), relative to the mesh's center. */
  readonly positions: Float32Array;
  /** The vertex of each row, (R). A vertex at a texture seam has several rows. */
  readonly vertexOf: Uint32Array;
  readonly geometry = new BufferGeometry();
  readonly faces: Faces;
  /** Whether surface is hidden if its heat, the weight in the heat map, is below 0.05. */
  isolated = false;
  private readonly pose: PoseTextures;
  readonly posed: PosePass;
  /** Uniforms that all materials share. */
  private readonly shared = { heatStrength: { value: 1 }, fade: { value: 1 } };
  private readonly materials: ShaderMaterial[];
  private readonly wires: Mesh<BufferGeometry, ShaderMaterial>;
  private readonly textures: Texture[] = [];
  /** The mean length of the triangles' sides, mesh units. */
  private readonly edge: number;
  private look: Look = "texture";
  private heats = false;
  private hidden = false;
  private asked = false;

  constructor(
    readonly message: MeshMessage,
    payload: Payload,
    renderer: WebGLRenderer,
    private readonly changed: () => void,
  ) {
    this.radius = Math.max(message.diagonal / 2, 1e-9);
    this.positions = payload.get("positions", "F32");
    this.vertexOf = payload.get("vertex", "U32");
    this.pose = new PoseTextures(message.vertices);
    this.posed = new PosePass(renderer, this.positions, payload.get("normals", "I16"), this.vertexOf, this.pose);
    const triangles = payload.get("triangles", "U32");
    this.faces = new Faces(this.positions, triangles);
    this.edge = meanEdge(this.positions, triangles);
    const { geometry } = this;
    const { position, normal, rest } = this.posed;
    // three.js needs `position` to count the rows.
    Object.assign(geometry.attributes, { position, posedPosition: position, posedNormal: normal, rest });
    geometry.setIndex(new BufferAttribute(triangles, 1));
    if (payload.has("uv")) geometry.setAttribute("uv", new BufferAttribute(payload.get("uv", "F32"), 2));
    if (payload.has("colors"))
      geometry.setAttribute("rowColor", new BufferAttribute(payload.get("colors", "U8"), 4, true));
    geometry.boundingSphere = new Sphere(new Vector3(), this.radius);
    for (const { start, count, material } of message.groups) geometry.addGroup(3 * start, 3 * count, material);
    this.materials = message.materials.map((entry) => this.material(entry, payload));
    const flat = { baseColor: { value: new Color(WIRE) }, opacity: { value: 0.5 }, near: { value: 1 } };
    this.wires = new Mesh(
      geometry,
      material("surface", flat, { defines: { FLAT: "" }, wireframe: true, transparent: true, depthWrite: false }),
    );
    this.wires.visible = false;
    this.group.add(new Mesh(geometry, this.materials), this.wires);
    // Frustum culling would hide poses that leave the bounding sphere of the resting shape.
    for (const drawn of this.group.children) drawn.frustumCulled = false;
  }

  show(scene: Scene): void {
    if (sameScene(scene, this.pose.scene)) return;
    this.pose.show(scene);
    this.posed.invalidate();
    this.heats = scene.columns.some((column) => column.heat !== 0);
    this.compile();
  }

  /** Set the look, and the X-ray and isolate modes. */
  dress(state: State): void {
    const { look, xray, comparing, wireframe } = state;
    this.look = look;
    this.asked = state.weights;
    this.isolated = isolates(state);
    this.wires.visible = wireframe && !this.isolated;
    this.shared.heatStrength.value = comparing ? 0 : 1;
    this.shared.fade.value = xray ? 0.4 : 1;
    for (const each of this.materials) {
      each.transparent = xray || each.uniforms.blends.value === true;
      each.depthWrite = !xray;
    }
    this.compile();
  }

  /** Hide the colors of weights for a picture, unless the look or the user asks for them. */
  hideHeat(hide: boolean): void {
    this.hidden = hide && this.look !== "heat" && !this.asked;
    this.compile();
  }

  /** Draw the wireframe fainter where edges are short in the picture, so that they do not cover the shape. */
  fadeWires(slopeOfPixel: number): void {
    this.wires.material.uniforms.near.value = this.edge / slopeOfPixel / LONG_EDGE;
  }

  /** Set the colors that show the features of the vertices, (V, 4). */
  setFeatureColors(colors: Uint8Array): void {
    this.geometry.setAttribute("featureColor", new BufferAttribute(this.perRow(colors, 4), 4, true));
    this.compile();
  }

  /** Show the server's pose. If `posed` is null, show the shader's pose. */
  setPosed(posed: Posed | null): void {
    this.posed.setGiven(
      posed && { positions: this.perRow(posed.positions, 3), normals: this.perRow(posed.normals, 4) },
    );
  }

  /** Return the resting position of a row. */
  at(row: number): Vec3 {
    return [this.positions[3 * row], this.positions[3 * row + 1], this.positions[3 * row + 2]];
  }

  dispose(): void {
    this.geometry.dispose();
    this.posed.dispose();
    this.pose.dispose();
    for (const texture of this.textures) {
      (texture.image as ImageBitmap | null)?.close();
      texture.dispose();
    }
    for (const each of [...this.materials, this.wires.material]) each.dispose();
    this.group.removeFromParent();
  }

  /** Convert `width` numbers per vertex to numbers per row. */
  private perRow<Numbers extends Float32Array | Int16Array | Uint8Array>(values: Numbers, width: number): Numbers {
    const { vertexOf } = this;
    const rows = new (values.constructor as new (length: number) => Numbers)(width * vertexOf.length);
    for (let row = 0; row < vertexOf.length; row++) {
      for (let i = 0; i < width; i++) rows[width * row + i] = values[width * vertexOf[row] + i];
    }
    return rows;
  }

  /** Compile the materials for the present look and modes. */
  private compile(): void {
    const { look, heats, geometry } = this;
    const own = look === "texture";
    const defines = {
      OWN: own,
      COLORS: own && geometry.hasAttribute("rowColor"),
      FEATURES: look === "features" && geometry.hasAttribute("featureColor"),
      HEAT: look === "heat" || (look !== "features" && heats && !this.hidden),
      HEAT_ALONE: look === "heat",
      ISOLATED: this.isolated,
    };
    for (const each of this.materials) define(each, { ...defines, MAP: own && each.uniforms.map.value !== null });
  }

  private material(entry: MaterialEntry, payload: Payload): ShaderMaterial {
    const [red, green, blue, alpha] = entry.color;
    const uniforms: Record<string, IUniform> = {
      ...this.shared,
      baseColor: { value: new Color().setRGB(red, green, blue, SRGBColorSpace) },
      map: { value: null },
      opacity: { value: alpha },
      blends: { value: entry.alpha_mode === "BLEND" },
      cutoff: { value: entry.alpha_mode === "MASK" ? entry.alpha_cutoff : 0 },
    };
    if (entry.texture) void this.picture(entry, payload.get(entry.texture, "U8"), uniforms.map);
    return material("surface", uniforms, {
      side: DoubleSide,
      transparent: entry.alpha_mode === "BLEND",
      // Push the surface back, so that it does not hide the wireframe.
      polygonOffset: true,
      polygonOffsetFactor: 1,
      polygonOffsetUnits: 1,
    });
  }

  private async picture(entry: MaterialEntry, file: Uint8Array, map: IUniform): Promise<void> {
    const blob = new Blob([file.slice()], { type: entry.media_type ?? "image/png" });
    try {
      // Texture coordinate v points upwards, so the first row of texels is the lowest row of the picture.
      const image = await createImageBitmap(blob, { imageOrientation: "flipY", premultiplyAlpha: "none" });
      const texture = new Texture(image, Texture.DEFAULT_MAPPING, WRAPS[entry.wrap[0]], WRAPS[entry.wrap[1]]);
      texture.flipY = false;
      texture.colorSpace = SRGBColorSpace;
      texture.anisotropy = 4;
      texture.needsUpdate = true;
      this.textures.push(texture);
      map.value = texture;
      this.compile();
      this.changed();
    } catch {
      // If the browser cannot read the picture, the material keeps its plain color.
    }
  }
}

/** Return the mean length of the first side of about 1,000 triangles. */
function meanEdge(positions: Float32Array, triangles: Uint32Array): number {
  const step = 3 * Math.max(Math.floor(triangles.length / 3000), 1);
  const [a, b] = [new Vector3(), new Vector3()];
  let [sum, count] = [0, 0];
  for (let corner = 0; corner < triangles.length; corner += step, count++) {
    sum += a.fromArray(positions, 3 * triangles[corner]).distanceTo(b.fromArray(positions, 3 * triangles[corner + 1]));
  }
  return count > 0 ? sum / count : 1;
}
