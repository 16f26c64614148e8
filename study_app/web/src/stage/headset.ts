/** The participant's headset: a WebXR session behind the same kernel, in a file of its own.
 *
 * A trigger gives the answer of its side, a grip pauses. Pages are pictures before the eyes; those on
 * which something is typed or chosen come after the headset is off.
 */
import type { AttemptRun } from "../kernel/attempt";
import type { Page, PageResult } from "../kernel/conduct";
import type { Machine, WebHeadset } from "../kernel/formats";
import { encoded, poseOf, turnedAway, UNTRACKED, type Pose } from "../kernel/poses";
import type { Device, On, Opened } from "./device";
import { machineOf, measuredRate, nearestRate, Refusal } from "./gate";
import { headsetWordsOf, textPage, PAGE_DISTANCE_PX, type HeadsetWords } from "./headset_pages";
import { button, lineOf, showParts } from "./note";
import { Observing } from "./observing";
import { showPage } from "./pages";
import { tangentsOf, Views } from "./views";
import { wordsOf } from "./words";

const HANDS: readonly XRHandedness[] = ["left", "right"];
type Refreshed = (now_ms: number, views: readonly XRView[], pose: Pose) => void;

export const headsetDevice: Device = {
  words: (language) => ({ ...wordsOf(language), ...headsetWordsOf(language).page }),
  told: (language) => headsetWordsOf(language),
  async check(study, words) {
    const there = await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false);
    if (!study.headset || !there) throw new Refusal(words.phone);
  },
  open,
};

async function open(on: On): Promise<Opened> {
  const { study, words, files } = on;
  const asked = study.headset;
  const gl = on.canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
  if (!gl || !asked) throw new Refusal(words.phone);
  const session = new Session(gl, asked.rates, on);
  await session.enter().catch(() => session.back()); // a press just asked; if it is too long ago, one more does
  try {
    const pictures = await files.pictures();
    const { background, window_px } = study;
    const views = new Views(gl, { ...asked, background, window_px, pictures });
    return await new Headset(on, asked, session, views).measured();
  } catch (error) {
    await session.leave();
    throw error;
  }
}

/** A session of the headset, which the participant may end and take up again. */
class Session {
  /** Called as it ends. */
  ended: () => void = () => undefined;
  session: XRSession | null = null;
  layer: XRWebGLLayer | null = null;
  readonly events = new EventTarget();
  private space: XRReferenceSpace | null = null;
  private waiting: Refreshed | null = null;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    private readonly rates: readonly number[],
    private readonly on: On,
  ) {}

  async enter(): Promise<void> {
    if (!navigator.xr) throw new Error("this browser has no WebXR");
    const session = await navigator.xr.requestSession("immersive-vr", { requiredFeatures: ["local"] });
    await this.gl.makeXRCompatible(); // asked for with the context, it blocks the page
    const framebufferScaleFactor = XRWebGLLayer.getNativeFramebufferScaleFactor(session);
    const layer = new XRWebGLLayer(session, this.gl, { antialias: false, alpha: false, framebufferScaleFactor });
    layer.fixedFoveation = 0; // the headset's own would lower the periphery
    await session.updateRenderState({ baseLayer: layer });
    const known = session.supportedFrameRates;
    const wanted = this.rates.find((rate) => known?.includes(rate));
    if (wanted !== undefined) await session.updateTargetFrameRate(wanted).catch(() => undefined); // it is measured
    this.space = await session.requestReferenceSpace("local");
    for (const name of ["selectstart", "squeezestart", "visibilitychange", "inputsourceschange"]) {
      session.addEventListener(name as "selectstart", (event) => {
        this.events.dispatchEvent(Object.assign(new Event(name), { told: event }));
      });
    }
    session.addEventListener("end", () => {
      if (this.session !== session) return; // the page ended it
      this.session = null;
      this.events.dispatchEvent(new Event("end"));
      this.ended();
    });
    [this.session, this.layer] = [session, layer];
    this.again();
  }

  /** Take the participant out of the headset. */
  async leave(): Promise<void> {
    const { session } = this;
    this.session = this.waiting = null;
    await session?.end();
  }

  /** Wait until the participant is in the headset. */
  async back(): Promise<void> {
    const { pages, words } = this.on;
    while (!this.session) {
      await new Promise<void>((resolve) => {
        const next = button(words.resume, "next", resolve);
        showParts(pages, "headset", lineOf(words.fullScreen), next);
      });
      await this.enter().catch(() => undefined);
    }
    pages.hidden = true;
  }

  /** Wait anew for a refresh that does not come, since its session is over. */
  again(without = false): void {
    if (this.waiting) this.refresh(this.waiting, without);
  }

  /** Call at the next refresh of the headset. Where its session is over: of the page, or of the next one. */
  refresh(call: Refreshed, without = false): void {
    const { session, space } = this;
    this.waiting = call;
    const come = (now_ms: number, seen: XRViewerPose | undefined) => {
      if (this.waiting !== call || this.session !== session) return;
      this.waiting = null;
      call(now_ms, seen?.views ?? [], seen ? poseOf(seen.transform.orientation) : UNTRACKED);
    };
    if (session && space) {
      session.requestAnimationFrame((now_ms, frame) => {
        come(now_ms, frame.getViewerPose(space));
      });
    } else if (without) {
      requestAnimationFrame((now_ms) => {
        come(now_ms, undefined);
      });
    }
  }
}

class Headset extends Observing {
  private readonly texts: HeadsetWords;
  private asks: readonly (readonly string[])[] = [];
  private goOn: ((leaves: boolean) => void) | null = null;

  constructor(
    private readonly on: On,
    private readonly headset: WebHeadset,
    private readonly session: Session,
    private readonly views: Views,
  ) {
    super(on.files, on.words);
    this.texts = headsetWordsOf(document.documentElement.lang);
    const { events } = session;
    const source = (event: Event) => (event as Event & { told: XRInputSourceEvent }).told;
    events.addEventListener("selectstart", (event) => {
      const { inputSource, timeStamp } = source(event);
      if (this.goOn) this.goOn(false);
      else this.trigger(inputSource.handedness, timeStamp);
    });
    events.addEventListener("squeezestart", (event) => {
      const [key] = this.on.study.pause_keys;
      if (this.goOn) this.goOn(true);
      else if (key !== undefined) this.pressed(key, source(event).timeStamp);
    });
    this.disturbs(events, "visibilitychange", "hidden", () => session.session?.visibilityState !== "visible");
    this.disturbs(events, "end", "session-end");
    this.disturbs(events, "inputsourceschange", "controller-lost", (event) => {
      const { removed } = (event as Event & { told: XRInputSourcesChangeEvent }).told;
      return removed.length > 0;
    });
    session.ended = () => {
      if (this.watching) session.again(true);
      else void session.back();
    };
  }

  /** Measure the headset, and show the test picture. */
  async measured(): Promise<Opened> {
    const { study, words } = this.on;
    let views: readonly XRView[] = [];
    this.write(words.measuring, null);
    const measured = await measuredRate((call) => {
      this.session.refresh((now_ms, seen) => {
        if (seen.length) views = seen;
        this.draw(seen);
        call(now_ms);
      });
    });
    const rate = nearestRate(study, words, measured.refresh_hz);
    const machine = machineOf(measured, { ...ON_HEADSET, window_px: this.size() }, this.device(views));
    await this.read("test", this.texts.test, this.texts.goes, 0);
    const close = () => this.session.leave();
    return { stage: this, rate, machine, close };
  }

  async attempt(run: AttemptRun): Promise<void> {
    await this.session.back();
    const { canvas } = this.on;
    const poses: Pose[] = [];
    run.poses = () => encoded(poses);
    return this.watched(
      new Promise<void>((resolve, reject) => {
        let drawn: Pose | null = null;
        const tick: Refreshed = (now_ms, views, pose) => {
          try {
            if (drawn) {
              poses.push(drawn);
              this.flipped(run, now_ms, drawn);
            }
            if (run.done) {
              this.views.show(null);
              this.draw(views);
              resolve();
              return;
            }
            const shown = run.shows();
            this.asks = shown.phase.question?.keys ?? this.asks;
            this.views.show(shown);
            this.draw(views);
            canvas.dataset["phase"] = shown.phase.name; // for whoever drives the page
            drawn = pose;
            this.session.refresh(tick, true);
          } catch (error) {
            reject(error instanceof Error ? error : new Error(String(error)));
          }
        };
        this.session.refresh(tick, true);
      }),
    ).finally(() => {
      delete canvas.dataset["phase"];
    });
  }

  /** A page in the headset: a trigger goes on, a grip leaves. Questions come after it is off. */
  async page(page: Page): Promise<PageResult> {
    if (page.question) {
      await this.session.leave();
      return showPage(this.on.pages, page, this.on.study, this.words);
    }
    await this.session.back();
    const began_ms = performance.now();
    const { agrees, stays, goes } = this.texts;
    const hint = page.name === "consent" ? agrees : page.name === "quit" ? stays : goes;
    const leaves = await this.read(page.name, page.text, hint, page.least_s, page.done_share);
    return { leaves, answer: "", duration_s: Math.round((performance.now() - began_ms) * 1e3) / 1e6 };
  }

  protected waits(why: string): void {
    this.write(why, null);
    this.stays();
  }

  protected hold(frames: readonly (readonly ImageBitmap[])[]): void {
    this.views.hold(frames);
  }

  /** Show a text until the participant goes on or leaves; true: leaves. */
  private async read(name: string, text: string, hint: string, least_s: number, share = 0): Promise<boolean> {
    const { canvas } = this.on;
    const began_ms = performance.now();
    this.write(text, least_s > 0 ? null : hint, share);
    const may = setTimeout(() => {
      this.write(text, hint, share);
    }, 1000 * least_s);
    this.stays();
    canvas.dataset["page"] = name; // for whoever drives the page
    const leaves = await new Promise<boolean>((resolve) => {
      this.goOn = (leaves) => {
        if (leaves || performance.now() - began_ms >= 1000 * least_s) resolve(leaves);
      };
    });
    clearTimeout(may);
    this.goOn = null;
    delete canvas.dataset["page"];
    return leaves;
  }

  private write(text: string, hint: string | null, share = 0): void {
    this.views.write(textPage(text, hint, share, this.on.study.background), PAGE_DISTANCE_PX);
  }

  /** Draw what is shown at every refresh, until something else is. */
  private stays(): void {
    const tick: Refreshed = (_, views) => {
      this.draw(views);
      this.session.refresh(tick);
    };
    this.session.refresh(tick);
  }

  private draw(views: readonly XRView[]): void {
    const { layer, session } = this.session;
    if (session && layer) this.views.draw(layer, views);
  }

  /** The picture that was drawn for this pose came at `now_ms`. */
  private flipped(run: AttemptRun, now_ms: number, pose: Pose): void {
    const { turn_deg } = this.headset;
    const { watched } = run.shows().phase;
    const between = this.observed(() => {
      if (pose === UNTRACKED) return "head-lost";
      return watched && turn_deg !== null && turnedAway(pose, turn_deg) ? "turned" : null;
    });
    run.flipped(this.clock_us(now_ms), ...between);
  }

  /** The left trigger stands for the first answer's first key, the right one for the second's. */
  private trigger(hand: XRHandedness, stamp_ms: number): void {
    const key = this.asks[HANDS.indexOf(hand)]?.[0];
    this.pressed(key ?? `trigger-${hand}`, stamp_ms);
  }

  private size(): [number, number] {
    const { layer } = this.session;
    return [layer?.framebufferWidth ?? 1, layer?.framebufferHeight ?? 1];
  }

  private device(views: readonly XRView[]): NonNullable<Machine["headset"]> {
    const { layer, session } = this.session;
    const rounded = (value: number, digits: number) => Math.round(value * 10 ** digits) / 10 ** digits;
    const [left, right] = views.map(({ transform }) => transform.position);
    const apart = left && right ? Math.hypot(right.x - left.x, right.y - left.y, right.z - left.z) : 0;
    const source = session?.inputSources[0];
    return {
      profile: source?.profiles[0] ?? "unknown",
      eye_distance_m: rounded(apart, 3),
      views: views.map((view) => {
        const { width = 1, height = 1 } = layer?.getViewport(view) ?? {};
        const [a, b, c, d] = tangentsOf(view).map((tangent) => rounded(tangent, 5));
        return { eye: view.eye, size_px: [width, height], tangents: [a ?? 0, b ?? 0, c ?? 0, d ?? 0] };
      }),
    };
  }
}

const ON_HEADSET = { device_pixel_ratio: 1, scale: 1, full_screen: true };
