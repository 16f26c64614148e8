/** Draws what a script shows, pixel by pixel, as `study_app/paint.py` defines it.
 *
 * WebGL where there is one: frames of a trial are texture arrays, and pictures are blended with
 * straight alpha. Without it, a 2D canvas, on which smooth edges of pictures may be off by one code in
 * Firefox. Nothing is ever read back: some browsers answer with noise.
 */
import type { Shown } from "../kernel/attempt";
import type { WebPhase } from "../kernel/formats";
import { frameOf } from "../kernel/script";

type Entry = WebPhase["show"][number];

export interface Painter {
  /** `webgl` or `2d`. */
  readonly kind: string;
  /** Make a trial's stimuli ready: entry i holds the frames of stimulus i. */
  hold(stimuli: readonly (readonly ImageBitmap[])[]): void;
  paint(shown: Shown | null): void;
  /** The canvas has another size. */
  resize(width_px: number, height_px: number): void;
  /** The red, green, blue, alpha of what was painted, rows from the top; for tests. */
  pixels(): Uint8Array;
}

interface Look {
  readonly background: number;
  /** Screen pixels per pixel of a stimulus. */
  readonly scale: number;
  readonly pictures: ReadonlyMap<string, ImageBitmap>;
  /** Nothing is where no entry is, in place of the background. */
  readonly clear?: boolean;
}

export function painterOf(canvas: HTMLCanvasElement, look: Look): Painter {
  const gl = canvas.getContext("webgl2", {
    alpha: false,
    antialias: false,
    preserveDrawingBuffer: true,
  });
  if (gl) return new GLPainter(gl, look);
  const context = canvas.getContext("2d", { alpha: false });
  if (!context) throw new Error("this browser draws on no canvas");
  return new Painter2D(context, look);
}

/** Everything that one flip shows, in its order. */
function entriesOf(shown: Shown | null): { entry: Entry; refreshes: number }[] {
  if (!shown) return [];
  return [...(shown.notice ? [shown.notice] : []), ...shown.phase.show].map((entry) => ({ entry, refreshes: shown.refreshes }));
}

class Painter2D implements Painter {
  readonly kind = "2d";
  private stimuli: readonly (readonly ImageBitmap[])[] = [];

  constructor(
    private readonly context: CanvasRenderingContext2D,
    private readonly look: Look,
  ) {}

  hold(stimuli: readonly (readonly ImageBitmap[])[]): void {
    this.stimuli = stimuli;
  }

  resize(): void {
    this.context.imageSmoothingEnabled = false;
  }

  paint(shown: Shown | null): void {
    const { context, look } = this;
    const { width, height } = context.canvas;
    const [x, y, k] = [Math.floor(width / 2), Math.floor(height / 2), look.scale];
    context.imageSmoothingEnabled = false;
    context.fillStyle = greyOf(look.background);
    context.fillRect(0, 0, width, height);
    for (const { entry, refreshes } of entriesOf(shown)) {
      if (entry.kind === "fill") {
        const [left, top, wide, high] = entry.rect;
        context.fillStyle = greyOf(entry.grey);
        context.fillRect(x + k * left, y + k * top, k * wide, k * high);
        continue;
      }
      const frames = entry.kind === "frames" ? this.stimuli[entry.stimulus] : undefined;
      const image =
        entry.kind === "frames"
          ? frames?.[frameOf(entry, refreshes)]
          : look.pictures.get(entry.of);
      if (!image) throw new Error("what a phase shows is not ready");
      const crop = (entry.kind === "frames" && entry.crop) || [0, 0, image.width, image.height];
      const [left, top] = entry.at;
      const [wide, high] = [crop[2], crop[3]];
      context.drawImage(image, crop[0], crop[1], wide, high, x + k * left, y + k * top, k * wide, k * high);
    }
  }

  pixels(): Uint8Array {
    const { width, height } = this.context.canvas;
    return new Uint8Array(this.context.getImageData(0, 0, width, height).data);
  }
}

function greyOf(grey: number): string {
  return `rgb(${grey} ${grey} ${grey})`;
}

const VERTEX = `#version 300 es
uniform ivec4 u_rect; // left, top, width, height on the canvas
uniform ivec2 u_canvas;
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  vec2 place = (vec2(u_rect.xy) + corner * vec2(u_rect.zw)) / vec2(u_canvas);
  gl_Position = vec4(2.0 * place.x - 1.0, 1.0 - 2.0 * place.y, 0.0, 1.0);
}`;
/** Texels are fetched, never sampled: what stands in the file is what is drawn. */
const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2DArray;
uniform sampler2DArray u_image;
uniform ivec4 u_rect;
uniform ivec2 u_canvas;
uniform ivec2 u_crop; // first column and row that is shown
uniform int u_layer;
uniform int u_scale;
uniform float u_grey; // from 0 on: this grey in place of the image
out vec4 colour;
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.x, float(u_canvas.y) - gl_FragCoord.y) - u_rect.xy;
  if (u_grey >= 0.0) colour = vec4(vec3(u_grey), 1.0);
  else colour = texelFetch(u_image, ivec3(u_crop + pixel / u_scale, u_layer), 0);
}`;

export class GLPainter implements Painter {
  readonly kind = "webgl";
  /** Frames of each of a trial's stimuli. */
  stimuli: WebGLTexture[] = [];
  private size: readonly [number, number] = [0, 0];
  private canvas: readonly [number, number] = [0, 0];
  private readonly program: WebGLProgram;
  private readonly pictures = new Map<string, { texture: WebGLTexture; size: [number, number] }>();
  private readonly place: (name: string) => WebGLUniformLocation | null;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    private readonly look: Look,
  ) {
    const program = programOf(gl, VERTEX, FRAGMENT);
    this.program = program;
    gl.disable(gl.DITHER);
    gl.enable(gl.BLEND);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE);
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    const places = new Map<string, WebGLUniformLocation | null>();
    this.place = (name) => {
      if (!places.has(name)) places.set(name, gl.getUniformLocation(program, name));
      return places.get(name) ?? null;
    };
    for (const [name, picture] of look.pictures) {
      const size: [number, number] = [picture.width, picture.height];
      this.pictures.set(name, { texture: this.texture([picture]), size });
    }
  }

  hold(stimuli: readonly (readonly ImageBitmap[])[]): void {
    this.stimuli.forEach((texture) => {
      this.gl.deleteTexture(texture);
    });
    this.stimuli = stimuli.map((frames) => this.texture(frames));
    this.size = [stimuli[0]?.[0]?.width ?? 0, stimuli[0]?.[0]?.height ?? 0];
    this.gl.finish();
  }

  resize(width_px: number, height_px: number): void {
    this.canvas = [width_px, height_px];
  }

  paint(shown: Shown | null): void {
    const { gl, look } = this;
    gl.useProgram(this.program);
    gl.viewport(0, 0, ...this.canvas);
    gl.uniform2i(this.place("u_canvas"), ...this.canvas);
    gl.uniform1i(this.place("u_scale"), look.scale);
    const grey = look.clear ? 0 : look.background / 255;
    gl.clearColor(grey, grey, grey, look.clear ? 0 : 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    for (const { entry, refreshes } of entriesOf(shown)) this.entry(entry, refreshes);
  }

  pixels(): Uint8Array {
    const { gl } = this;
    const { width, height } = gl.canvas;
    const upward = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, upward);
    const pixels = new Uint8Array(upward.length);
    for (let row = 0; row < height; row++) {
      const from = 4 * width * (height - 1 - row);
      pixels.set(upward.subarray(from, from + 4 * width), 4 * width * row);
    }
    return pixels;
  }

  private entry(entry: Entry, refreshes: number): void {
    if (entry.kind === "fill") {
      this.rect(entry.rect, [0, 0], 0, entry.grey / 255);
      return;
    }
    if (entry.kind === "frames") {
      const texture = this.stimuli[entry.stimulus];
      if (!texture) throw new Error("what a phase shows is not ready");
      const [x, y, wide, high] = entry.crop ?? [0, 0, ...this.size];
      this.gl.bindTexture(this.gl.TEXTURE_2D_ARRAY, texture);
      this.rect([...entry.at, wide, high], [x, y], frameOf(entry, refreshes), -1);
      return;
    }
    const picture = this.pictures.get(entry.of);
    if (!picture) throw new Error("what a phase shows is not ready");
    this.gl.bindTexture(this.gl.TEXTURE_2D_ARRAY, picture.texture);
    this.rect([...entry.at, ...picture.size], [0, 0], 0, -1);
  }

  /** A rectangle of the screen, by the place of its corner from the middle. */
  private rect(
    rect: readonly [number, number, number, number],
    crop: readonly [number, number],
    layer: number,
    grey: number,
  ): void {
    const { gl, look } = this;
    const k = look.scale;
    const [width, height] = this.canvas;
    const left = Math.floor(width / 2) + k * rect[0];
    const top = Math.floor(height / 2) + k * rect[1];
    gl.uniform4i(this.place("u_rect"), left, top, k * rect[2], k * rect[3]);
    gl.uniform2i(this.place("u_crop"), crop[0], crop[1]);
    gl.uniform1i(this.place("u_layer"), layer);
    gl.uniform1f(this.place("u_grey"), grey);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  private texture(layers: readonly ImageBitmap[]): WebGLTexture {
    const { gl } = this;
    const texture = gl.createTexture();
    const [width, height] = [layers[0]?.width ?? 1, layers[0]?.height ?? 1];
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, width, height, layers.length);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    layers.forEach((image, layer) => {
      gl.texSubImage3D(
        gl.TEXTURE_2D_ARRAY, 0, 0, 0, layer, width, height, 1, gl.RGBA, gl.UNSIGNED_BYTE, image,
      );
    });
    return texture;
  }
}

export function programOf(gl: WebGL2RenderingContext, vertex: string, fragment: string): WebGLProgram {
  const program = gl.createProgram();
  for (const [kind, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ] as const) {
    const shader = gl.createShader(kind);
    if (!shader) throw new Error("this browser compiles no shader");
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    throw new Error(`this browser draws no textures (${gl.getProgramInfoLog(program) ?? ""})`);
  }
  return program;
}
