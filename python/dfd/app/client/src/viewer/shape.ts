/** The mesh on the GPU: geometry, materials and pose. */

import * as THREE from "three";

import type { Vec3 } from "../posing/affine";
import { sameScene, type Scene } from "../posing/columns";
import type { Payload } from "../protocol/binary_messages";
import type { MaterialEntry, MeshMessage } from "../protocol/messages";
import { isolates, type Look, type State } from "../store/state";
import { Faces } from "./posing/faces";
import { PosePass } from "./posing/pose_pass";
import { PoseTextures } from "./posing/pose_textures";
import { define, material } from "./posing/shaders";

const WIRE = "#10182c";
/** Edges of at least this number of pixels are drawn at full strength; shorter edges are fainter. */
const LONG_EDGE = 14;
const WRAPS = {
  repeat: THREE.RepeatWrapping,
  mirror: THREE.MirroredRepeatWrapping,
  clamp: THREE.ClampToEdgeWrapping,
} as const;

export class Shape {
  readonly group = new THREE.Group();
  readonly radius: number;
  /** The resting position of each row, (R, 3), relative to the mesh's center. */
  readonly positions: Float32Array;
  /** The vertex of each row, (R). A vertex at a texture seam has several rows. */
  readonly vertexOf: Uint32Array;
  readonly geometry = new THREE.BufferGeometry();
  readonly faces: Faces;
  /** Whether surface is hidden if its heat, the weight in the heat map, is below 0.05. */
  isolated = false;
  private readonly pose: PoseTextures;
  readonly posed: PosePass;
  /** Uniforms that all materials share. */
  private readonly shared = { heatStrength: { value: 1 }, fade: { value: 1 } };
  private readonly materials: THREE.ShaderMaterial[];
  private readonly wires: THREE.Mesh<THREE.BufferGeometry, THREE.ShaderMaterial>;
  private readonly textures: THREE.Texture[] = [];
  /** The mean length of the triangles' sides, mesh units. */
  private readonly edge: number;
  private look: Look = "texture";
  private heats = false;
  private hidden = false;
  private asked = false;

  constructor(
    readonly message: MeshMessage,
    payload: Payload,
    renderer: THREE.WebGLRenderer,
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
    geometry.setAttribute("position", new THREE.BufferAttribute(this.positions, 3));
    geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
    if (payload.has("uv")) geometry.setAttribute("uv", new THREE.BufferAttribute(payload.get("uv", "F32"), 2));
    if (payload.has("colors"))
      geometry.setAttribute("rowColor", new THREE.BufferAttribute(payload.get("colors", "U8"), 4, true));
    geometry.boundingSphere = new THREE.Sphere(new THREE.Vector3(), this.radius);
    for (const { start, count, material } of message.groups) geometry.addGroup(3 * start, 3 * count, material);
    this.materials = message.materials.map((entry) => this.material(entry, payload));
    const flat = {
      ...this.posed.uniforms,
      baseColor: { value: new THREE.Color(WIRE) },
      opacity: { value: 0.5 },
      near: { value: 1 },
    };
    this.wires = new THREE.Mesh(
      geometry,
      material("surface", flat, { defines: { FLAT: "" }, wireframe: true, transparent: true, depthWrite: false }),
    );
    this.wires.visible = false;
    this.group.add(new THREE.Mesh(geometry, this.materials), this.wires);
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
    const words = new Uint32Array(colors.slice().buffer);
    const rows = new Uint8Array(Uint32Array.from(this.vertexOf, (vertex) => words[vertex]).buffer);
    this.geometry.setAttribute("featureColor", new THREE.BufferAttribute(rows, 4, true));
    this.compile();
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

  private material(entry: MaterialEntry, payload: Payload): THREE.ShaderMaterial {
    const [red, green, blue, alpha] = entry.color;
    const uniforms: Record<string, THREE.IUniform> = {
      ...this.shared,
      ...this.posed.uniforms,
      baseColor: { value: new THREE.Color().setRGB(red, green, blue, THREE.SRGBColorSpace) },
      map: { value: null },
      opacity: { value: alpha },
      blends: { value: entry.alpha_mode === "BLEND" },
      cutoff: { value: entry.alpha_mode === "MASK" ? entry.alpha_cutoff : 0 },
    };
    if (entry.texture) void this.picture(entry, payload.get(entry.texture, "U8"), uniforms.map);
    return material("surface", uniforms, {
      side: THREE.DoubleSide,
      transparent: entry.alpha_mode === "BLEND",
      // Push the surface back, so that it does not hide the wireframe.
      polygonOffset: true,
      polygonOffsetFactor: 1,
      polygonOffsetUnits: 1,
    });
  }

  private async picture(entry: MaterialEntry, file: Uint8Array, map: THREE.IUniform): Promise<void> {
    const blob = new Blob([file.slice()], { type: entry.media_type ?? "image/png" });
    try {
      // THREE.Texture coordinate v points upwards, so the first row of texels is the lowest row of the picture.
      const image = await createImageBitmap(blob, { imageOrientation: "flipY", premultiplyAlpha: "none" });
      const texture = new THREE.Texture(
        image,
        THREE.Texture.DEFAULT_MAPPING,
        WRAPS[entry.wrap[0]],
        WRAPS[entry.wrap[1]],
      );
      texture.flipY = false;
      texture.colorSpace = THREE.SRGBColorSpace;
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
  const [a, b] = [new THREE.Vector3(), new THREE.Vector3()];
  let [sum, count] = [0, 0];
  for (let corner = 0; corner < triangles.length; corner += step, count++) {
    sum += a.fromArray(positions, 3 * triangles[corner]).distanceTo(b.fromArray(positions, 3 * triangles[corner + 1]));
  }
  return count > 0 ? sum / count : 1;
}
