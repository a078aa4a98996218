/** The shape posed on the GPU, once for each change, into buffers: what is drawn and picked afterwards only reads them. */

import { GLBufferAttribute, Matrix4, type WebGLRenderer } from "three";

import type { Posed } from "../../store/state";
import { ATTRIBUTES, PosePrograms } from "./pose_program";
import { matrix4, type PoseTextures } from "./pose_textures";

/** What every row is made of: (R, 3) at rest, (R, 4) normals of length 32767, (R) vertices. */
export interface Rows {
  readonly positions: Float32Array;
  readonly normals: Int16Array;
  readonly vertexOf: Uint32Array;
}

export class PosePass {
  /** (R, 4) posed positions and heat. */
  readonly position: GLBufferAttribute;
  /** (R, 3) posed unit normals. */
  readonly normal: GLBufferAttribute;
  /** (R, 3) at rest. */
  readonly rest: GLBufferAttribute;
  private readonly gl: WebGL2RenderingContext;
  private readonly programs: PosePrograms;
  private readonly count: number;
  private made: Buffers;
  private given: Posed | null = null;
  private showsGiven = false;
  /** How many rows, from the first on, are posed as the scene is now. */
  private fresh = 0;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly rows: Rows,
    private readonly pose: PoseTextures,
  ) {
    const gl = renderer.getContext() as WebGL2RenderingContext;
    this.gl = gl;
    this.count = rows.vertexOf.length;
    this.programs = new PosePrograms(gl);
    this.made = new Buffers(gl, rows);
    this.position = new GLBufferAttribute(this.made.position, gl.FLOAT, 4, 4, this.count);
    this.normal = new GLBufferAttribute(this.made.normal, gl.FLOAT, 3, 4, this.count);
    this.rest = new GLBufferAttribute(this.made.rest, gl.FLOAT, 3, 4, this.count);
    renderer.resetState();
    renderer.domElement.addEventListener("webglcontextrestored", this.restore);
  }

  /** Something that the pose is made of has changed. */
  invalidate(): void {
    this.fresh = 0;
  }

  /** Take what the server posed, (R, 3) and (R, 4), or null; it is shown where `useGiven` says so. */
  setGiven(given: Posed | null): void {
    if (!given && !this.given) return;
    this.given = given;
    this.made.setGiven(given);
    this.renderer.resetState();
    this.fresh = 0;
  }

  /** Whether what the server posed is shown, where there is something. */
  get usesGiven(): boolean {
    return this.showsGiven;
  }

  /** Returns whether what the server posed is or was shown. */
  useGiven(on: boolean): boolean {
    const shown = this.given !== null && (on || this.showsGiven);
    if (this.showsGiven !== on && this.given) this.fresh = 0;
    this.showsGiven = on;
    return shown;
  }

  /** Have the first `count` rows posed as the scene is now, and no more of them than are not yet. */
  update(count: number): void {
    if (this.fresh >= count || this.gl.isContextLost()) return;
    const first = this.fresh;
    this.fresh = count;
    const { gl, pose, renderer } = this;
    pose.textures.forEach((texture) => renderer.initTexture(texture));
    const defines: ReadonlySet<string> =
      this.showsGiven && this.given ? new Set([...pose.defines, "GIVEN"]) : pose.defines;
    const { program, at } = this.programs.with(defines);
    gl.useProgram(program);
    const { mirror, defaultTransform } = pose.scene;
    [gl.TEXTURE_2D_ARRAY, gl.TEXTURE_2D].forEach((target, unit) => {
      const { __webglTexture } = renderer.properties.get(pose.textures[unit]) as { __webglTexture: WebGLTexture };
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(target, __webglTexture);
    });
    gl.uniform1i(at.distances, 0);
    gl.uniform1i(at.columns, 1);
    gl.uniform1i(at.columnCount, pose.columnCount);
    gl.uniformMatrix4fv(at.defaultTransform, false, (defaultTransform ? matrix4(defaultTransform) : REST).elements);
    if (mirror) gl.uniform4f(at.mirror, ...mirror.normal, mirror.offset);
    gl.uniform1f(at.mirrorBand, mirror?.band ?? 0);
    this.made.run(first, count - first);
    renderer.resetState();
  }

  /** (R, 4) posed positions and heat, read back. */
  read(): Float32Array {
    this.update(this.count);
    const { gl } = this;
    const found = new Float32Array(4 * this.count);
    gl.bindBuffer(gl.COPY_READ_BUFFER, this.made.position);
    gl.getBufferSubData(gl.COPY_READ_BUFFER, 0, found);
    gl.bindBuffer(gl.COPY_READ_BUFFER, null);
    return found;
  }

  dispose(): void {
    this.renderer.domElement.removeEventListener("webglcontextrestored", this.restore);
    this.made.dispose();
    this.programs.dispose();
  }

  /** Graphics that were lost took the buffers along. */
  private readonly restore = (): void => {
    this.programs.forget();
    this.made = new Buffers(this.gl, this.rows);
    this.made.setGiven(this.given);
    this.position.setBuffer(this.made.position);
    this.normal.setBuffer(this.made.normal);
    this.rest.setBuffer(this.made.rest);
    this.renderer.resetState();
    this.fresh = 0;
  };
}

const REST = new Matrix4();

/** What the pass reads and writes on the GPU. */
class Buffers {
  readonly position: WebGLBuffer;
  readonly normal: WebGLBuffer;
  readonly rest: WebGLBuffer;
  private readonly others: WebGLBuffer[];
  private readonly given: readonly [WebGLBuffer, WebGLBuffer];
  private readonly input: WebGLVertexArrayObject;
  private readonly output: WebGLTransformFeedback;
  /** A pixel that nobody sees. */
  private readonly nowhere: WebGLFramebuffer;
  private readonly pixel: WebGLRenderbuffer;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    { positions, normals, vertexOf }: Rows,
  ) {
    const count = vertexOf.length;
    this.input = gl.createVertexArray();
    gl.bindVertexArray(this.input);
    this.rest = this.filled(positions, gl.STATIC_DRAW);
    this.reads(ATTRIBUTES.rest, 3, gl.FLOAT);
    const restNormal = this.filled(normals, gl.STATIC_DRAW);
    this.reads(ATTRIBUTES.restNormal, 4, gl.SHORT);
    const vertex = this.filled(vertexOf, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(ATTRIBUTES.vertex);
    gl.vertexAttribIPointer(ATTRIBUTES.vertex, 1, gl.UNSIGNED_INT, 0, 0);
    this.given = [gl.createBuffer(), gl.createBuffer()];
    this.position = this.filled(16 * count, gl.DYNAMIC_COPY);
    this.normal = this.filled(12 * count, gl.DYNAMIC_COPY);
    this.others = [this.rest, restNormal, vertex, this.position, this.normal, ...this.given];
    gl.bindVertexArray(null);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    this.output = gl.createTransformFeedback();
    this.nowhere = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.nowhere);
    const pixel = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, pixel);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, 1, 1);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, pixel);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.pixel = pixel;
  }

  setGiven(given: Posed | null): void {
    const { gl } = this;
    gl.bindVertexArray(this.input);
    const places = [ATTRIBUTES.givenPosition, ATTRIBUTES.givenNormal];
    this.given.forEach((buffer, i) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      if (!given) {
        gl.disableVertexAttribArray(places[i]);
        gl.bufferData(gl.ARRAY_BUFFER, 0, gl.DYNAMIC_DRAW);
        return;
      }
      gl.bufferData(gl.ARRAY_BUFFER, i === 0 ? given.positions : given.normals, gl.DYNAMIC_DRAW);
      if (i === 0) this.reads(places[i], 3, gl.FLOAT);
      else this.reads(places[i], 4, gl.SHORT);
    });
    gl.bindVertexArray(null);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
  }

  /** Run the program in use over `count` rows from the `first` on. */
  run(first: number, count: number): void {
    const { gl } = this;
    // Nothing is written that is bound anywhere else, as three.js leaves what it drew from.
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    gl.bindVertexArray(this.input);
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, this.output);
    gl.bindBufferRange(gl.TRANSFORM_FEEDBACK_BUFFER, 0, this.position, 16 * first, 16 * count);
    gl.bindBufferRange(gl.TRANSFORM_FEEDBACK_BUFFER, 1, this.normal, 12 * first, 12 * count);
    // On the canvas browsers take it for a drawing, and show a new picture in which nothing has been drawn yet.
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.nowhere);
    gl.enable(gl.RASTERIZER_DISCARD);
    gl.beginTransformFeedback(gl.POINTS);
    gl.drawArrays(gl.POINTS, first, count);
    gl.endTransformFeedback();
    gl.disable(gl.RASTERIZER_DISCARD);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, null);
    gl.bindBuffer(gl.TRANSFORM_FEEDBACK_BUFFER, null);
    gl.bindVertexArray(null);
  }

  dispose(): void {
    const { gl } = this;
    this.others.forEach((buffer) => gl.deleteBuffer(buffer));
    gl.deleteVertexArray(this.input);
    gl.deleteTransformFeedback(this.output);
    gl.deleteFramebuffer(this.nowhere);
    gl.deleteRenderbuffer(this.pixel);
  }

  private filled(data: Float32Array | Int16Array | Uint32Array | number, usage: GLenum): WebGLBuffer {
    const { gl } = this;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    if (typeof data === "number") gl.bufferData(gl.ARRAY_BUFFER, data, usage);
    else gl.bufferData(gl.ARRAY_BUFFER, data, usage);
    return buffer;
  }

  /** Whole numbers stand for what lies between -1 and 1. */
  private reads(place: number, size: number, type: GLenum): void {
    const { gl } = this;
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, type !== gl.FLOAT, 0, 0);
  }
}
