/** Files of the study: each is hashed before anything is decoded, and a wrong one is named. */
import type { Pack, PictureFile, WebStudy } from "../kernel/study";

/** A file that is not the one that was hashed, or did not come. */
export class FileError extends Error {}

export async function sha256(data: BufferSource): Promise<string> {
  const digest = await crypto.subtle.digest("SHA-256", data);
  return [...new Uint8Array(digest)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** Fetch a file whole; three tries, for lines that break. */
export async function fetched(
  url: string,
  cache: RequestCache = "default",
  tries = 3,
): Promise<ArrayBuffer> {
  for (let left = tries; ; left--) {
    try {
      const response = await fetch(url, { cache });
      if (response.ok) return await response.arrayBuffer();
      if (left <= 1 || response.status === 404) {
        throw new FileError(`${url} did not come (the server says ${response.status})`);
      }
    } catch (error) {
      if (error instanceof FileError) throw error;
      if (left <= 1) throw new FileError(`${url} did not come (${String(error)})`);
    }
    await new Promise((resolve) => setTimeout(resolve, 1000 * (tries - left + 1)));
  }
}

/** Codes as they are in the file: no colour profile, no premultiplied alpha. */
async function decoded(data: ArrayBuffer, name: string): Promise<ImageBitmap> {
  try {
    const blob = new Blob([data], { type: "image/png" });
    return await createImageBitmap(blob, { premultiplyAlpha: "none", colorSpaceConversion: "none" });
  } catch {
    throw new FileError(`${name} is no picture that this browser can read`);
  }
}

export class Files {
  private readonly packs = new Map<string, Promise<ImageBitmap[]>>();

  constructor(
    private readonly study: WebStudy,
    private readonly base = "",
  ) {}

  /** The frames of a stimulus, checked and decoded; kept until `keep` lets them go. */
  frames(name: string): Promise<ImageBitmap[]> {
    const there = this.packs.get(name);
    if (there) return there;
    const pack = this.study.stimuli[name];
    if (!pack) throw new FileError(`${name} is none of the study's stimuli`);
    const loading = this.load(name, pack);
    this.packs.set(name, loading);
    // Whoever waits is told; another try begins anew.
    loading.catch(() => this.packs.delete(name));
    return loading;
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

  private async picture(file: PictureFile): Promise<ImageBitmap> {
    const data = await fetched(`${this.base}pictures/${file.file}`);
    if ((await sha256(data)) !== file.sha256) {
      throw new FileError(`pictures/${file.file} is not the picture that was hashed`);
    }
    return decoded(data, file.file);
  }

  private async load(name: string, pack: Pack): Promise<ImageBitmap[]> {
    try {
      return await this.checked(name, pack, "force-cache");
    } catch {
      return await this.checked(name, pack, "reload"); // what was kept may be what is broken
    }
  }

  private async checked(name: string, pack: Pack, cache: RequestCache): Promise<ImageBitmap[]> {
    const [width, height] = this.study.stimulus_px;
    const data = await fetched(`${this.base}packs/${encodeURIComponent(pack.file)}`, cache);
    if (data.byteLength !== pack.bytes) {
      throw new FileError(
        `packs/${pack.file} must have ${pack.bytes} bytes (has ${data.byteLength})`,
      );
    }
    const pieces = pack.ends.map((end, index) => data.slice(pack.ends[index - 1] ?? 0, end));
    const hashes = await Promise.all(pieces.map(sha256));
    const wrong = hashes.findIndex((hash, index) => hash !== pack.sha256[index]);
    if (wrong >= 0) throw new FileError(`frame ${wrong} of ${name} is not the one that was hashed`);
    const frames = await Promise.all(pieces.map((piece) => decoded(piece, name)));
    const odd = frames.find((frame) => frame.width !== width || frame.height !== height);
    if (odd) {
      throw new FileError(
        `${name} must be ${width} x ${height} px (is ${odd.width} x ${odd.height})`,
      );
    }
    return frames;
  }
}
