/** Device on which a study is shown: the screen of this page, or a headset. */
import type { Machine, RefreshRate, WebStudy } from "../kernel/formats";
import type { Files } from "./files";
import type { Observing } from "./observing";
import type { Words } from "./words";

/** Parts of the page that a device shows a study with. */
export interface On {
  /** Over the whole viewport. */
  readonly canvas: HTMLCanvasElement;
  /** Over the canvas. */
  readonly pages: HTMLElement;
  readonly study: WebStudy;
  readonly files: Files;
  readonly words: Words;
}

export interface Opened {
  readonly stage: Observing;
  readonly rate: RefreshRate;
  readonly machine: Machine;
  /** Give the device back. */
  close?(): Promise<void>;
}

export interface Device {
  words(language: string): Words;
  /** Texts of the first page: which buttons are used (null: the study's keys), and what to do before. */
  told(language: string): { readonly keys: readonly string[] | null; readonly before: readonly string[] };
  /** Refuse what cannot run the study. */
  check(study: WebStudy, words: Words, pages: HTMLElement): Promise<void>;
  /** Take the device, just after a press asked for it. */
  open(on: On): Promise<Opened>;
}
