/** The stage without a session: paints what it is told, and compares it with what Python expects. */
import type { ShownPicture, WebPhase, WebStudy } from "../src/kernel/formats";
import { fetched, Files } from "../src/stage/files";
import { painterOf, type Painter } from "../src/stage/painter";
import { cover } from "../src/stage/view";

const canvas = document.createElement("canvas");
let painter: Painter;

type Contexts = HTMLCanvasElement["getContext"];

/** As in a browser without WebGL. */
function flatOnly(all: Contexts): Contexts {
  return ((kind: string, wishes?: unknown) => (kind === "2d" ? all(kind, wishes) : null)) as Contexts;
}

const lab = {
  /** Size of the canvas, and what draws on it. Frames of one stimulus are those of several. */
  async open(stimuli: string[][], scale: number, flat: boolean): Promise<[number, number, string]> {
    const study = JSON.parse(new TextDecoder().decode(await fetched("study.json"))) as WebStudy;
    canvas.className = "metamerlab-stage";
    document.body.append(canvas);
    const [width, height] = await cover(canvas);
    const files = new Files(study);
    const pictures = await files.pictures();
    const frames = await Promise.all(
      stimuli.map(async (names) => (await Promise.all(names.map((one) => files.frames(one)))).flat()),
    );
    if (flat) canvas.getContext = flatOnly(canvas.getContext.bind(canvas));
    painter = painterOf(canvas, { background: study.background, scale, pictures });
    painter.resize(width, height);
    painter.hold(frames);
    return [width, height, painter.kind];
  },
  paint(phase: WebPhase, refreshes: number, notice: ShownPicture | null): void {
    painter.paint({ phase, refreshes, notice });
  },
  /** Of the canvas: how many pixels differ from the file, and by how many codes at most. */
  async differs(file: string): Promise<[number, number]> {
    const wanted = new Uint8Array(await fetched(file));
    const got = painter.pixels();
    if (3 * got.length !== 4 * wanted.length) return [-1, got.length];
    let [pixels, codes] = [0, 0];
    for (let pixel = 0; pixel < got.length / 4; pixel++) {
      let off = 255 - (got[4 * pixel + 3] ?? 0);
      for (let channel = 0; channel < 3; channel++) {
        const one = (got[4 * pixel + channel] ?? 0) - (wanted[3 * pixel + channel] ?? 0);
        off = Math.max(off, Math.abs(one));
      }
      pixels += Number(off > 0);
      codes = Math.max(codes, off);
    }
    return [pixels, codes];
  },
};
Object.assign(globalThis, { lab });
