/** Draws into the eyes of a headset what a script shows, as `study_app/web/eye_views.py` defines it.
 *
 * The painter of the screen draws a flat screen, pixel by pixel; here it is put before the eyes, at
 * the study's distance. A panorama is all around, behind it. Only directions count, not places.
 */
import type { Shown } from "../kernel/attempt";
import { frameOf } from "../kernel/script";
import { GLPainter, programOf } from "./painter";

/** Pixels of background around the flat screen, so that its edge is that of what it shows. */
const MARGIN_PX = 2;

const VERTEX = `#version 300 es
uniform mat3 u_back; // from the eye's image, -1 to 1, to directions in the room
out vec3 v_ray;
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  v_ray = u_back * vec3(corner, 1.0);
  gl_Position = vec4(corner, 0.0, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2DArray;
uniform highp sampler2D u_screen; // colours times alpha; its rows go up
uniform sampler2DArray u_around;
uniform int u_layer; // of the panorama; below 0: there is none
uniform float u_distance; // of the screen, in its pixels
uniform float u_grey;
in vec3 v_ray;
out vec4 colour;
const float PI = 3.14159265358979;
void main() {
  vec3 ray = normalize(v_ray);
  vec3 behind = vec3(u_grey);
  if (u_layer >= 0) {
    vec2 at = vec2(atan(ray.x, -ray.z) / (2.0 * PI) + 0.5, 0.5 - asin(clamp(ray.y, -1.0, 1.0)) / PI);
    behind = textureLod(u_around, vec3(at, float(u_layer)), 0.0).rgb;
  }
  vec2 size = vec2(textureSize(u_screen, 0));
  vec2 at = ray.z < 0.0 ? u_distance * ray.xy / -ray.z / size + 0.5 : vec2(-1.0);
  vec4 front = at == clamp(at, 0.0, 1.0) ? textureLod(u_screen, at, 0.0) : vec4(0.0);
  colour = vec4(front.rgb + behind * (1.0 - front.a), 1.0);
}`;

interface Look {
  readonly background: number;
  readonly distance_px: number;
  readonly around: boolean;
  readonly window_px: readonly [number, number];
  readonly pictures: ReadonlyMap<string, ImageBitmap>;
}

export class Views {
  private readonly painter: GLPainter;
  private readonly program: WebGLProgram;
  private readonly screen: WebGLTexture;
  private readonly page: WebGLTexture;
  private readonly drawn: WebGLFramebuffer;
  private readonly wraps: WebGLSampler;
  /** The texture in front, and its distance in pixels. */
  private front: readonly [WebGLTexture, number];
  /** Phase, notice and frames that are on the flat screen. */
  private painted: readonly unknown[] | null = null;
  /** The panorama, and its layer. */
  private behind: readonly [WebGLTexture, number] | null = null;

  constructor(
    readonly gl: WebGL2RenderingContext,
    private readonly look: Look,
  ) {
    this.program = programOf(gl, VERTEX, FRAGMENT);
    this.painter = new GLPainter(gl, { ...look, scale: 1, clear: look.around });
    const size = look.window_px.map((edge) => edge + 2 * MARGIN_PX) as [number, number];
    this.painter.resize(...size);
    this.screen = this.texture();
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, ...size);
    this.drawn = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.drawn);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.screen, 0);
    this.page = this.texture();
    this.front = [this.screen, look.distance_px];
    this.wraps = gl.createSampler();
    const { LINEAR, REPEAT, TEXTURE_MIN_FILTER, TEXTURE_MAG_FILTER, TEXTURE_WRAP_S } = gl;
    for (const [name, value] of [[TEXTURE_MIN_FILTER, LINEAR], [TEXTURE_MAG_FILTER, LINEAR], [TEXTURE_WRAP_S, REPEAT]] as const) {
      gl.samplerParameteri(this.wraps, name, value);
    }
    gl.samplerParameteri(this.wraps, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  }

  hold(frames: readonly (readonly ImageBitmap[])[]): void {
    this.painted = null;
    this.painter.hold(frames);
  }

  /** From now on the eyes see this flip of a script; null: the background. */
  show(shown: Shown | null): void {
    const { gl, look, painter } = this;
    const around = look.around ? shown?.phase.show.find((entry) => entry.kind === "frames") : undefined;
    const texture = around && painter.stimuli[around.stimulus];
    this.behind = around && texture && shown ? [texture, frameOf(around, shown.refreshes)] : null;
    const flat = look.around ? shown?.phase.show.filter((entry) => entry.kind !== "frames") : shown?.phase.show;
    this.front = [this.screen, look.distance_px];
    const numbers = (shown?.phase.show ?? []).map((entry) => (entry.kind === "frames" ? frameOf(entry, shown?.refreshes ?? 0) : 0));
    const now = [shown?.phase, shown?.notice, numbers.join()] as const;
    const same = now.every((part, index) => part === this.painted?.[index]);
    this.painted = now;
    if (same) return;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindSampler(0, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.drawn);
    painter.paint(shown && flat ? { ...shown, phase: { ...shown.phase, show: flat } } : null);
  }

  /** From now on the eyes see a page: a canvas whose rows go up. */
  write(page: OffscreenCanvas, distance_px: number): void {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.page);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, page);
    [this.front, this.behind] = [[this.page, distance_px], null];
  }

  /** Draw into both eyes. */
  draw(layer: XRWebGLLayer, views: readonly XRView[]): void {
    const { gl, program } = this;
    const place = (name: string) => gl.getUniformLocation(program, name);
    gl.useProgram(program);
    gl.bindFramebuffer(gl.FRAMEBUFFER, layer.framebuffer);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.behind?.[0] ?? null);
    gl.bindSampler(1, this.wraps);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.front[0]);
    gl.uniform1i(place("u_screen"), 0);
    gl.uniform1i(place("u_around"), 1);
    gl.uniform1i(place("u_layer"), this.behind?.[1] ?? -1);
    gl.uniform1f(place("u_distance"), this.front[1]);
    gl.uniform1f(place("u_grey"), this.look.background / 255);
    for (const view of views) {
      const port = layer.getViewport(view);
      if (!port) continue;
      gl.viewport(port.x, port.y, port.width, port.height);
      gl.uniformMatrix3fv(place("u_back"), false, backward(view));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
  }

  private texture(): WebGLTexture {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    const { LINEAR, CLAMP_TO_EDGE } = gl;
    for (const [name, value] of [
      [gl.TEXTURE_MIN_FILTER, LINEAR], [gl.TEXTURE_MAG_FILTER, LINEAR],
      [gl.TEXTURE_WRAP_S, CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, CLAMP_TO_EDGE],
    ] as const) gl.texParameteri(gl.TEXTURE_2D, name, value);
    return texture;
  }
}

/** Tangents of the angles from straight ahead to a view's left, right, lower and upper edge. */
export function tangentsOf({ projectionMatrix: p }: XRView): [number, number, number, number] {
  const [wide = 1, high = 1, aside = 0, up = 0] = [p[0], p[5], p[8], p[9]];
  return [(aside - 1) / wide, (aside + 1) / wide, (up - 1) / high, (up + 1) / high];
}

/** From the image of a view to directions in the room: its turn after its projection's inverse. */
function backward(view: XRView): Float32Array {
  const [left, right, down, up] = tangentsOf(view);
  const m = view.transform.matrix;
  const turned = (x: number, y: number, z: number) =>
    [0, 1, 2].map((row) => (m[row] ?? 0) * x + (m[4 + row] ?? 0) * y + (m[8 + row] ?? 0) * z);
  const middle = turned((left + right) / 2, (down + up) / 2, -1);
  return new Float32Array([...turned((right - left) / 2, 0, 0), ...turned(0, (up - down) / 2, 0), ...middle]);
}
