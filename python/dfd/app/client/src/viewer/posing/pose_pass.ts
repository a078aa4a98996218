/** Pose the shape on the GPU once per change. Drawing and picking read the results from buffers. */

import { GLBufferAttribute, type WebGLRenderer } from "three";

import { IDENTITY } from "../../posing/affine";
import type { Posed } from "../../store/state";
import pose from "../../shaders/pose.glsl?raw";
import pass from "../../shaders/pose_pass.glsl?raw";
import { definesOf, type PoseTextures } from "./pose_textures";

const ATTRIBUTES = { rest: 0, restNormal: 1, vertex: 2, givenPosition: 3, givenNormal: 4 } as const;
const VARYINGS = ["posedPosition", "posedNormal"];
const UNIFORMS = ["weights", "columns", "columnCount", "defaultTransform", "mirror", "mirrorBand"] as const;
const NOTHING = new Uint8Array(0);

interface Program {
  readonly program: WebGLProgram;
  readonly at: Readonly<Record<(typeof UNIFORMS)[number], WebGLUniformLocation | null>>;
}

export class PosePass {
  /** The posed position and the heat of each row, (R, 4). */
  readonly position: GLBufferAttribute;
  /** The posed unit normal of each row, (R, 3). */
  readonly normal: GLBufferAttribute;
  /** The resting position of each row, (R, 3). */
  readonly rest: GLBufferAttribute;
  private readonly gl: WebGL2RenderingContext;
  /** The pose shader, compiled once for each set of defines. */
  private readonly programs = new Map<string, Program>();
  private readonly count: number;
  private readonly buffers: WebGLBuffer[] = [];
  private readonly input: WebGLVertexArrayObject;
  private readonly output: WebGLTransformFeedback;
  private readonly framebuffer: WebGLFramebuffer;
  private readonly pixel: WebGLRenderbuffer;
  private readonly givenPosition: WebGLBuffer;
  private readonly givenNormal: WebGLBuffer;
  private given = false;
  /** Whether the buffers contain the present pose. */
  private fresh = false;

  /** Takes the arrays of a `MeshMessage`: resting positions (R, 3), normals (R, 4) and the vertex of each row (R). */
  constructor(
    private readonly renderer: WebGLRenderer,
    positions: Float32Array,
    normals: Int16Array,
    vertexOf: Uint32Array,
    private readonly pose: PoseTextures,
  ) {
    const gl = renderer.getContext() as WebGL2RenderingContext;
    this.gl = gl;
    this.count = vertexOf.length;
    this.input = gl.createVertexArray();
    gl.bindVertexArray(this.input);
    const rest = this.filled(positions);
    this.readAttribute(ATTRIBUTES.rest, 3, gl.FLOAT);
    this.filled(normals);
    this.readAttribute(ATTRIBUTES.restNormal, 4, gl.SHORT);
    this.filled(vertexOf);
    gl.enableVertexAttribArray(ATTRIBUTES.vertex);
    gl.vertexAttribIPointer(ATTRIBUTES.vertex, 1, gl.UNSIGNED_INT, 0, 0);
    this.givenPosition = this.filled(0);
    this.givenNormal = this.filled(0);
    const position = this.filled(16 * this.count);
    const normal = this.filled(12 * this.count);
    gl.bindVertexArray(null);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    this.output = gl.createTransformFeedback();
    // The pass needs its own framebuffer. Otherwise, browsers would clear the canvas.
    this.framebuffer = gl.createFramebuffer();
    this.pixel = gl.createRenderbuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.pixel);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, 1, 1);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, this.pixel);
    this.position = new GLBufferAttribute(position, gl.FLOAT, 4, 4, this.count);
    this.normal = new GLBufferAttribute(normal, gl.FLOAT, 3, 4, this.count);
    this.rest = new GLBufferAttribute(rest, gl.FLOAT, 3, 4, this.count);
    renderer.resetState();
  }

  /** Mark the pose as outdated. */
  invalidate(): void {
    this.fresh = false;
  }

  /** Use the server's positions (R, 3) and normals (R, 4). If `given` is null, the shader computes them. */
  setGiven(given: Posed | null): void {
    if (!given && !this.given) return;
    const { gl } = this;
    this.given = given !== null;
    this.fresh = false;
    gl.bindVertexArray(this.input);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.givenPosition);
    gl.bufferData(gl.ARRAY_BUFFER, given?.positions ?? NOTHING, gl.DYNAMIC_DRAW);
    this.readAttribute(ATTRIBUTES.givenPosition, 3, gl.FLOAT, this.given);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.givenNormal);
    gl.bufferData(gl.ARRAY_BUFFER, given?.normals ?? NOTHING, gl.DYNAMIC_DRAW);
    this.readAttribute(ATTRIBUTES.givenNormal, 4, gl.SHORT, this.given);
    gl.bindVertexArray(null);
    this.renderer.resetState();
  }

  /** Pose all rows, unless the buffers contain the present pose. */
  update(): void {
    if (this.fresh || this.gl.isContextLost()) return;
    this.fresh = true;
    const { gl, pose, renderer } = this;
    pose.textures.forEach((texture) => renderer.initTexture(texture));
    const defines = [...definesOf(pose.scene), ...(this.given ? ["GIVEN"] : [])];
    const { program, at } = this.programs.get(defines.join()) ?? compile(gl, defines);
    this.programs.set(defines.join(), { program, at });
    gl.useProgram(program);
    const { columns, mirror, defaultTransform } = pose.scene;
    [gl.TEXTURE_2D_ARRAY, gl.TEXTURE_2D].forEach((target, unit) => {
      const { __webglTexture } = renderer.properties.get(pose.textures[unit]) as { __webglTexture: WebGLTexture };
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(target, __webglTexture);
    });
    gl.uniform1i(at.weights, 0);
    gl.uniform1i(at.columns, 1);
    gl.uniform1i(at.columnCount, columns.length);
    gl.uniformMatrix4fv(at.defaultTransform, false, (defaultTransform ?? IDENTITY).elements);
    if (mirror) gl.uniform4f(at.mirror, ...mirror.normal, mirror.offset);
    gl.uniform1f(at.mirrorBand, mirror?.band ?? 0);
    // three.js leaves buffers bound, but transform feedback must not write to a bound buffer.
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    gl.bindVertexArray(this.input);
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, this.output);
    gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, this.position.buffer);
    gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 1, this.normal.buffer);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.enable(gl.RASTERIZER_DISCARD);
    gl.beginTransformFeedback(gl.POINTS);
    gl.drawArrays(gl.POINTS, 0, this.count);
    gl.endTransformFeedback();
    gl.disable(gl.RASTERIZER_DISCARD);
    gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, null);
    gl.bindBuffer(gl.TRANSFORM_FEEDBACK_BUFFER, null);
    gl.bindVertexArray(null);
    renderer.resetState();
  }

  /** Read the posed positions and the heat (R, 4) from the GPU. */
  read(): Float32Array {
    this.update();
    const { gl } = this;
    const found = new Float32Array(4 * this.count);
    gl.bindBuffer(gl.COPY_READ_BUFFER, this.position.buffer);
    gl.getBufferSubData(gl.COPY_READ_BUFFER, 0, found);
    gl.bindBuffer(gl.COPY_READ_BUFFER, null);
    return found;
  }

  dispose(): void {
    const { gl } = this;
    this.buffers.forEach((buffer) => gl.deleteBuffer(buffer));
    gl.deleteVertexArray(this.input);
    gl.deleteTransformFeedback(this.output);
    gl.deleteFramebuffer(this.framebuffer);
    gl.deleteRenderbuffer(this.pixel);
    this.programs.forEach(({ program }) => gl.deleteProgram(program));
  }

  /** Create and bind a buffer with the content `data`. If `data` is a number, it is the size in bytes. */
  private filled(data: Float32Array | Int16Array | Uint32Array | number): WebGLBuffer {
    const { gl } = this;
    const buffer = gl.createBuffer();
    this.buffers.push(buffer);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    if (typeof data === "number") gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_COPY);
    else gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    return buffer;
  }

  /** Let the shader read an attribute from the bound buffer. The GPU maps integers to numbers in [-1, 1]. */
  private readAttribute(place: number, size: number, type: GLenum, on = true): void {
    const { gl } = this;
    if (on) gl.enableVertexAttribArray(place);
    else gl.disableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, type !== gl.FLOAT, 0, 0);
  }
}

function compile(gl: WebGL2RenderingContext, defines: readonly string[]): Program {
  const defined = defines.map((name) => `#define ${name}\n`).join("");
  const header = "#version 300 es\nprecision highp float;\nprecision highp int;\n";
  const program = gl.createProgram();
  const shaders = [
    shader(gl, gl.VERTEX_SHADER, `${header}${defined}${pose}\n${pass}`),
    shader(gl, gl.FRAGMENT_SHADER, `${header}void main() {}`),
  ];
  shaders.forEach((each) => gl.attachShader(program, each));
  for (const [name, place] of Object.entries(ATTRIBUTES)) gl.bindAttribLocation(program, place, name);
  gl.transformFeedbackVaryings(program, VARYINGS, gl.SEPARATE_ATTRIBS);
  gl.linkProgram(program);
  shaders.forEach((each) => gl.deleteShader(each));
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
    throw new Error(`The pose shader does not link: ${gl.getProgramInfoLog(program)}`);
  const at = Object.fromEntries(UNIFORMS.map((name) => [name, gl.getUniformLocation(program, name)]));
  return { program, at: at as Program["at"] };
}

function shader(gl: WebGL2RenderingContext, type: GLenum, source: string): WebGLShader {
  const made = gl.createShader(type);
  if (!made) throw new Error("The graphics context is lost.");
  gl.shaderSource(made, source);
  gl.compileShader(made);
  if (!gl.getShaderParameter(made, gl.COMPILE_STATUS) && !gl.isContextLost())
    throw new Error(`The pose shader does not compile: ${gl.getShaderInfoLog(made)}`);
  return made;
}
