/** Files of the study: each is hashed before anything is decoded, and a wrong one is named. */
import type { Pack, PictureFile, WebStudy } from "../kernel/formats";
import { at } from "../kernel/list";
import { insist, UnsentError, type Told } from "../store/stores";

/** A file that is not the one that was hashed, or did not come. */
export class FileError extends Error {}

/** A file that did not come, though it was asked for again and again. */
class LineError extends FileError {}

export async function sha256(data: BufferSource): Promise<string> {
  const digest = await crypto.subtle.digest("SHA-256", data);
  return [...new Uint8Array(digest)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** Most bytes of one request for a part of a pack, unless a frame has more. */
const PART_BYTES = 2 ** 20;

/** Longest time without a byte, after which a request is sent anew. */
const SILENT_MS = 60_000;
/** Answers of a server that has too much to do, among the answers that asking again does not change. */
const BUSY = [408, 425, 429];

/** Fetch a file, or what an HTTP range of it gives; for minutes, where the line is down. */
export async function fetched(
  url: string,
  cache: RequestCache = "default",
  range = "",
  told?: Told,
): Promise<ArrayBuffer> {
  let keeps = cache;
  const ask = async () => {
    const asked = answerTo(url, { cache: keeps, headers: range ? { range } : {} });
    keeps = "reload"; // what failed may be kept, too
    const [status, data] = await asked;
    if (status < 400) return data;
    const error = new FileError(`${url} did not come (the server says ${status})`);
    if (status >= 500 || BUSY.includes(status)) throw error;
    return error;
  };
  const got = await insist(ask, told).catch((error: unknown) => {
    const { cause } = error as UnsentError;
    throw new LineError(cause instanceof FileError ? cause.message : `${url} did not come (${String(cause)})`);
  });
  if (got instanceof FileError) throw got;
  return got;
}

/** Status and bytes of an answer, of which each came soon after the one before. */
async function answerTo(url: string, asked: RequestInit): Promise<[number, ArrayBuffer]> {
  const end = new AbortController();
  const silent = () => {
    end.abort(new Error(`no byte for ${SILENT_MS / 1000} s`));
  };
  let timer = setTimeout(silent, SILENT_MS);
  try {
    const response = await fetch(url, { ...asked, signal: end.signal });
    const reader = response.body?.getReader();
    const parts: Uint8Array<ArrayBuffer>[] = [];
    for (let part = await reader?.read(); part && !part.done; part = await reader?.read()) {
      clearTimeout(timer);
      timer = setTimeout(silent, SILENT_MS);
      parts.push(part.value);
    }
    return [response.status, await new Blob(parts).arrayBuffer()];
  } finally {
    clearTimeout(timer);
  }
}

/** The parts in which a pack is fetched: first frame, and the one after the last. */
export function partsOf(pack: Pack): [number, number][] {
  const parts: [number, number][] = [];
  let began = 0;
  pack.ends.forEach((end, index) => {
    const last = parts.at(-1);
    if (last && end - began <= PART_BYTES) last[1] = index + 1;
    else {
      began = pack.ends[index - 1] ?? 0;
      parts.push([index, index + 1]);
    }
  });
  return parts;
}

/** First byte of a WebP file. */
const RIFF = 0x52;

/** Codes as they are in the file: no colour profile, no premultiplied alpha. */
async function decoded(data: ArrayBuffer, name: string): Promise<ImageBitmap> {
  try {
    const [first] = new Uint8Array(data, 0, 1);
    const blob = new Blob([data], { type: first === RIFF ? "image/webp" : "image/png" });
    return await createImageBitmap(blob, { premultiplyAlpha: "none", colorSpaceConversion: "none" });
  } catch {
    throw new FileError(`${name} is no picture that this browser can read`);
  }
}

/** Load something, and where what came was wrong, once more: what was kept may be broken, or a server's ranges. */
async function twice<T>(load: (again: boolean) => Promise<T>): Promise<T> {
  try {
    return await load(false);
  } catch (error) {
    if (error instanceof LineError) throw error; // it was asked for long enough
    return load(true);
  }
}

/** Return a pack that was loaded before; else load it. All who wait are told of a failure, and another try begins anew. */
function once<T>(
  name: string,
  there: Map<string, Promise<T>>,
  packs: Readonly<Record<string, Pack>>,
  load: (pack: Pack) => Promise<T>,
): Promise<T> {
  const found = there.get(name);
  if (found) return found;
  const pack = packs[name];
  if (!pack) throw new FileError(`${name} is none of the study's packs`);
  const loading = load(pack);
  there.set(name, loading);
  loading.catch(() => there.delete(name));
  return loading;
}

export class Files {
  /** Called as the line goes down, and as it comes back: whoever waits for files says so. */
  heard: () => void = () => undefined;
  private readonly packs = new Map<string, Promise<ImageBitmap[]>>();
  /** Coded pieces that several stimuli have, which are fetched once. */
  private readonly shared = new Map<string, Promise<ArrayBuffer[]>>();
  private failing = 0;

  constructor(
    private readonly study: WebStudy,
    private readonly base = "",
  ) {}

  /** True if a request is being tried anew. */
  get down(): boolean {
    return this.failing > 0;
  }

  /** The frames of a stimulus, checked and decoded; kept until `keep` lets them go. */
  frames(name: string): Promise<ImageBitmap[]> {
    return once(name, this.packs, this.study.stimuli, (pack) => this.load(name, pack));
  }

  /** Let go of all stimuli but these. */
  keep(names: readonly string[]): void {
    for (const [name, loading] of this.packs) {
      if (names.includes(name)) continue;
      this.packs.delete(name);
      void loading.then((frames) => {
        frames.forEach((frame) => {
          frame.close();
        });
      });
    }
  }

  async pictures(): Promise<Map<string, ImageBitmap>> {
    const entries = Object.entries(this.study.pictures);
    return new Map(
      await Promise.all(
        entries.map(async ([name, file]) => [name, await this.picture(file)] as const),
      ),
    );
  }

  private picture(file: PictureFile): Promise<ImageBitmap> {
    return twice(async (again) => {
      const data = await this.fetched(`pictures/${file.file}`, again ? "reload" : "default");
      if ((await sha256(data)) !== file.sha256) {
        throw new FileError(`pictures/${file.file} is not the picture that was hashed`);
      }
      return decoded(data, file.file);
    });
  }

  private async load(name: string, pack: Pack): Promise<ImageBitmap[]> {
    const shared = await Promise.all(pack.shared.map((one) => this.sharedPieces(one)));
    const pieces = [...shared.flat(), ...(await this.pieces(name, pack))];
    const frames = pack.frames.length ? pack.frames : pieces.map((_, number) => [number]);
    return Promise.all(frames.map((frame) => this.frame(name, frame.map((number) => at(pieces, number)))));
  }

  private sharedPieces(name: string): Promise<ArrayBuffer[]> {
    return once(name, this.shared, this.study.shared, (pack) => this.pieces(name, pack));
  }

  /** A frame, decoded: one piece, or put together of several, row by row. */
  private async frame(name: string, pieces: readonly ArrayBuffer[]): Promise<ImageBitmap> {
    const [width, height] = this.study.stimulus_px;
    const bitmaps = await Promise.all(pieces.map((piece) => decoded(piece, name)));
    const [first] = bitmaps;
    const fits = first?.width === width && first.height === height;
    if (first && bitmaps.length === 1 && fits) return first;
    const across = Math.ceil(width / this.study.piece_px);
    const down = Math.ceil(height / this.study.piece_px);
    const canvas = new OffscreenCanvas(width, height);
    const context = canvas.getContext("2d", { alpha: false });
    if (!context || bitmaps.length !== across * down || bitmaps.length === 1) {
      throw new FileError(`${name} must be ${width} x ${height} px (is ${first?.width} x ${first?.height})`);
    }
    bitmaps.forEach((bitmap, number) => {
      const [column, row] = [number % across, Math.floor(number / across)];
      context.drawImage(bitmap, column * this.study.piece_px, row * this.study.piece_px);
      bitmap.close();
    });
    return canvas.transferToImageBitmap();
  }

  /** The pictures of a pack, coded, each of which is the one that was hashed. */
  private pieces(name: string, pack: Pack): Promise<ArrayBuffer[]> {
    return twice((again) =>
      again
        ? this.inParts(name, pack, "reload", [[0, pack.ends.length]])
        : this.inParts(name, pack, "force-cache", partsOf(pack)),
    );
  }

  private fetched(path: string, cache: RequestCache, range = ""): Promise<ArrayBuffer> {
    return fetched(this.base + path, cache, range, (down) => {
      this.failing += down ? 1 : -1;
      this.heard();
    });
  }

  /** A pack part by part: where the line breaks, one is fetched again. */
  private async inParts(
    name: string,
    pack: Pack,
    cache: RequestCache,
    parts: readonly (readonly [number, number])[],
  ): Promise<ArrayBuffer[]> {
    const path = `packs/${encodeURIComponent(pack.file)}`;
    const found: ArrayBuffer[] = [];
    let whole: ArrayBuffer | null = null;
    for (const [first, after] of parts) {
      const [start, end] = [pack.ends[first - 1] ?? 0, pack.ends[after - 1] ?? 0];
      const range = parts.length > 1 ? `bytes=${start}-${end - 1}` : "";
      const data: ArrayBuffer = whole ?? (await this.fetched(path, cache, range));
      // A server without ranges sends the whole file.
      if (data.byteLength === pack.bytes) whole = data;
      else if (data.byteLength !== end - start) {
        const wanted = `must have ${pack.bytes} bytes`;
        throw new FileError(`packs/${pack.file} ${wanted} (has ${data.byteLength})`);
      }
      const from = whole ? 0 : start;
      const pieces = pack.ends
        .slice(first, after)
        .map((to, at) => data.slice((pack.ends[first + at - 1] ?? 0) - from, to - from));
      const hashes = await Promise.all(pieces.map(sha256));
      const wrong = hashes.findIndex((hash, at) => hash !== pack.sha256[first + at]);
      if (wrong >= 0) {
        throw new FileError(`frame ${first + wrong} of ${name} is not the one that was hashed`);
      }
      found.push(...pieces);
    }
    return found;
  }
}
