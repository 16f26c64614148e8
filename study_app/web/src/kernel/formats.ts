/** Made of `protocols/schemas/` by `npm run types`: change the models in Python, and make it again. */

/** The file `study.json` of an exported folder. */
export interface WebStudy {
  readonly background: number;
  /** Shortest break between two blocks. */ readonly break_s: number;
  readonly completion_code: string | null;
  readonly completion_url: string | null;
  readonly continue_keys: readonly string[];
  /** Largest memory that a trial's stimuli and the next one's take. */ readonly decoded_bytes: number;
  readonly default_language: string;
  readonly design: WebDesign;
  /** More missed refreshes than this make an attempt void. */ readonly dropped_max: number;
  /** Length of a session, answers in 1.5 s: the first page says it. */ readonly duration_s: number;
  /** Version of the file format. */ readonly format: 1;
  /** The study runs in a headset. Null: on a screen. */ readonly headset: WebHeadset | null;
  /** Parameter of the link whose value is kept. */ readonly identifier: string | null;
  readonly manifest_sha256: string;
  readonly pages: Readonly<Record<string, WebPages>>;
  readonly pause_keys: readonly string[];
  /** Pictures by the hash of what they show. */ readonly pictures: Readonly<Record<string, PictureFile>>;
  /** Edge of the square pieces, of which those at the right and the bottom may be smaller. */ readonly piece_px: number;
  readonly protocol_sha256: string;
  readonly quit_keys: readonly string[];
  readonly rates: readonly RefreshRate[];
  /** Version and git revision of metamerlab. */ readonly revision: string;
  /** Size of the screen that the study was made for: a click answers by its share of the width. */ readonly screen_px: readonly [number, number];
  /** Packs of pieces that several stimuli have, by names that tell nothing. */ readonly shared: Readonly<Record<string, Pack>>;
  /** Stimuli by names that tell nothing. */ readonly stimuli: Readonly<Record<string, Pack>>;
  readonly stimulus_px: readonly [number, number];
  readonly study: string;
  readonly title: string;
  /** Smallest part of the screen, about its middle, that shows all of a trial. */ readonly window_px: readonly [number, number];
}

/** A question after the last block. */
export interface ClosingQuestion {
  /** Default: free text. */ readonly choices: readonly string[];
  /** Its column in tables. */ readonly name: string;
  /** Text of the question. */ readonly text: string;
}

/** A rectangle of one grey. */
export interface Fill {
  readonly grey: number;
  readonly kind: "fill";
  readonly rect: readonly [number, number, number, number];
}

/** Frames of one of the trial's stimuli, pixel by pixel. */
export interface Frames {
  readonly at: readonly [number, number];
  /** The part that is shown, from the upper left corner of the frame. Null: all of it. */ readonly crop: readonly [number, number, number, number] | null;
  /** Refreshes that each frame stands for. 0: the first one stays. */ readonly every: number;
  readonly kind: "frames";
  /** Number of the last frame, from 0, which stays. */ readonly last: number;
  /** Number of the trial's stimulus, from 0. */ readonly stimulus: number;
}

/** Pictures one after the other in one file, each as PNG or lossless WebP: frames or pieces. */
export interface Pack {
  readonly bytes: number;
  /** End of each picture in the file, in bytes from its beginning. */ readonly ends: readonly number[];
  /** Name in the folder `packs`. */ readonly file: string;
  /** Pieces of each frame, row by row, by their numbers: those of shared packs come first. Empty: each picture is a frame. */ readonly frames: readonly (readonly number[])[];
  /** Hash of each picture's bytes in the file: of a frame's PNG file, as the manifest has it. */ readonly sha256: readonly string[];
  /** Packs of pieces that other stimuli have, too, by their names. */ readonly shared: readonly string[];
}

/** A picture that Python made: a PNG file. */
export interface PictureFile {
  /** Name in the folder `pictures`. */ readonly file: string;
  readonly sha256: string;
  readonly size_px: readonly [number, number];
}

/** The level whose answer is expected to tell most (QUEST+). */
export interface QuestPlusRule {
  /** Probability of a right answer: a row for each level, a column for each grid point. */ readonly correct: readonly (readonly number[])[];
  readonly kind: "quest-plus";
  /** Rising. */ readonly levels: readonly number[];
  /** Logarithm of the prior of each grid point. Null where its prior is 0. */ readonly log_prior: readonly (number | null)[];
}

/** A refresh rate at which the study runs. */
export interface RefreshRate {
  /** Excess of each time over the study's, by its place in the study file. Times that are kept are left out. */ readonly deviations_s: Readonly<Record<string, number>>;
  readonly refresh_hz: number;
  readonly scripts: Readonly<Record<string, readonly WebScript[]>>;
}

/** Question of a phase. The picture of its words is one of those that the phase shows. */
export interface ScriptQuestion {
  /** Names from left to right. */ readonly answers: readonly string[];
  /** A list of keys per answer. */ readonly keys: readonly (readonly string[])[];
  /** `answer`: the study's own question. */ readonly name: string;
  /** A click or touch gives an answer too: each has a column of the screen, equally wide. */ readonly pointer: boolean;
}

/** A picture at its place. */
export interface ShownPicture {
  readonly at: readonly [number, number];
  readonly kind: "picture";
  /** Its name among the study's pictures. */ readonly of: string;
}

/** An up-down track: the keys of the study's `[task.adaptive]`. */
export interface UpDownRule {
  readonly easier: readonly number[];
  readonly falling: boolean;
  readonly harder: readonly number[];
  readonly in_a_row: number;
  readonly kind: "up-down";
  /** Rising. */ readonly levels: readonly number[];
  readonly one_at_first: boolean;
  readonly start: number;
}

/** Rule that chooses trials from answers. */
export interface WebAdaptive {
  readonly rule: QuestPlusRule | UpDownRule;
  readonly tracks: readonly WebTrack[];
  /** Per track. */ readonly trials: number;
}

/** One way to show a condition. */
export interface WebArrangement {
  /** The right answer. Null where there is none, or the page can do without. */ readonly correct: string | null;
  /** Value in the column that an adaptive rule chooses. Null where there is none. */ readonly level: number | null;
  /** Scene, where an adaptive rule chooses among several. Null elsewhere. */ readonly scene: string | null;
  /** Names among the study's stimuli, as the task counts them. */ readonly stimuli: readonly string[];
}

/** One condition of the design. Its arrangements take turns over repeats and places. */
export interface WebCell {
  readonly arrangements: readonly WebArrangement[];
  /** Index, modulo their number, of the arrangement that comes first at place 0. */ readonly parity: number;
  readonly scene: string;
}

/** The design of a study, as a browser plans it. */
export interface WebDesign {
  readonly adaptive: WebAdaptive | null;
  /** Names from left to right, where keys are not swapped. */ readonly answers: readonly string[];
  readonly blocks: number;
  readonly catch_cells: readonly WebCell[];
  readonly catch_trials: number;
  /** Cells of the main trials. Empty where a rule chooses. */ readonly cells: readonly WebCell[];
  readonly consent_required: boolean;
  readonly max_attempts: number;
  readonly places: "by-arrival" | "drawn";
  /** Key by which places are drawn, the same in all browsers. Null where they are not drawn. */ readonly places_key: number | null;
  readonly practice: WebPractice | null;
  /** The closing questions, which are the same in every language. */ readonly questions: readonly string[];
  readonly repeats: number;
  /** After how many places arrangements and keys are balanced, and the scenes as well. */ readonly rounds: readonly [number, number];
  readonly scene_order: "random" | "balanced";
  /** Scenes of the main trials, which are told apart and not named. */ readonly scenes: readonly string[];
  /** Number of scenes that one participant is shown. */ readonly scenes_each: number;
  readonly side: "by-participant" | "by-trial" | "fixed";
}

/** A study's show in a headset. */
export interface WebHeadset {
  /** Stimuli are panoramas, all around; all else is on the flat screen before them. */ readonly around: boolean;
  /** Distance of the flat screen from the eyes, in its pixels. */ readonly distance_px: number;
  /** Refresh rates of the study, the one wanted most first. */ readonly rates: readonly number[];
  /** Largest angle of the head from straight ahead in watched phases. Null: any. */ readonly turn_deg: number | null;
}

/** Texts that a participant reads beside trials, placeholders of keys filled. */
export interface WebPages {
  /** `{done}` and `{total}` stand for numbers of blocks. */ readonly break_page: string;
  readonly consent: string;
  readonly instructions: readonly string[];
  /** Names of the keys that are used, for the first page. */ readonly key_names: Readonly<Record<string, string>>;
  readonly paused: string;
  readonly practice: string;
  readonly preparing: string;
  readonly questions: readonly ClosingQuestion[];
  readonly quit_question: string;
  readonly start: string;
  readonly thanks: string;
}

/** A phase of a trial, as `ScriptPhase` has it, with pictures by name. */
export interface WebPhase {
  readonly follows: Readonly<Record<string, ShownPicture>>;
  readonly frames: number | null;
  readonly gate_frames: number | null;
  readonly name: string;
  readonly question: ScriptQuestion | null;
  readonly show: readonly (Frames | ShownPicture | Fill)[];
  readonly timeout_frames: number | null;
  readonly watched: boolean;
}

/** Practice trials. */
export interface WebPractice {
  readonly cells: readonly WebCell[];
  /** Share of right answers below which another round follows. Null: one round only. */ readonly criterion_share: number | null;
  readonly rounds: number;
  /** Trials of a round. */ readonly trials: number;
}

/** The script of all trials that have these answers in this order. */
export interface WebScript {
  readonly answers: readonly string[];
  readonly phases: readonly WebPhase[];
  readonly practice: boolean;
}

/** Trials that are chosen from each other's answers. */
export interface WebTrack {
  readonly name: string;
  /** All that they may show. */ readonly options: readonly WebArrangement[];
}

/** Keys of every line. */
export interface Sent {
  /** Time on the participant's clock, UTC. */ readonly at: string;
  /** Number of the line, from 0, over all runs. */ readonly n: number;
  /** Drawn by chance when the page was opened: tells two tabs of one link apart. Null in lines of older pages. */ readonly opening: number | null;
  readonly participant: string;
  /** Number of the opening of the page that wrote it, from 0. */ readonly run: number;
  readonly study: string;
  /** Time on the page's clock: monotonic, 0 when this run opened it. */ readonly t_s: number;
}

/** An answer to a closing question. */
export interface AnswerLine extends Sent {
  readonly kind: "answer";
  readonly question: string;
  readonly text: string;
}

/** One attempt at a trial, with what was observed in it. */
export interface AttemptLine extends Sent {
  /** The answer given to the study's question. */ readonly answer: string | null;
  /** 1 for the first attempt at this trial. */ readonly attempt: number;
  /** After which flip something came between participant and page, and what. */ readonly disturbed: readonly [number, "focus" | "hidden" | "full-screen" | "size" | "turned" | "session-end" | "controller-lost" | "head-lost"] | null;
  /** Times of flips: the first on the page's clock, each other one since that before. */ readonly flips_us: readonly number[];
  readonly kind: "attempt";
  readonly outcome: "completed" | "void";
  /** Pose of the head at each flip, as it was drawn for: Base64 of four numbers of 16 bits each, the lower byte first, x, y, z, w of its unit quaternion times 32767. All 0: not tracked. Null where no headset was used. */ readonly poses: string | null;
  /** Number of this attempt in the session, from 0. */ readonly position: number;
  readonly presses: readonly Press[];
  /** The trial of the plan. */ readonly trial: string;
  /** Reason why a void attempt must be repeated. */ readonly void_reason: "gaze-break" | "data-loss" | "no-fixation" | "too-late" | "dropped-frames" | "paused" | "quit" | "focus-lost" | null;
  /** The window as the attempt began. Null in lines of older pages, which looked at it once, and of headsets. */ readonly window: BrowserWindow | null;
}

/** A block is over. */
export interface BlockEndLine extends Sent {
  readonly block: number;
  readonly kind: "block-end";
}

/** A block begins. */
export interface BlockStartLine extends Sent {
  readonly block: number;
  readonly kind: "block-start";
}

/** A break between blocks, sent at its end. */
export interface BreakLine extends Sent {
  readonly after_block: number;
  readonly duration_s: number;
  readonly kind: "break";
}

/** A browser's window, and how large it shows stimuli. */
export interface BrowserWindow {
  readonly device_pixel_ratio: number;
  readonly full_screen: boolean;
  /** Screen pixels per pixel of a stimulus, along an edge. */ readonly scale: number;
  /** Device pixels of the canvas. */ readonly window_px: readonly [number, number];
}

/** The participant read the consent page, and agreed or not. */
export interface ConsentLine extends Sent {
  readonly agreed: boolean;
  readonly kind: "consent";
  readonly text_sha256: string;
}

/** The session is over, or the participant left. */
export interface EndLine extends Sent {
  readonly kind: "end";
  readonly reason: "completed" | "quit" | "consent-refused" | "error";
}

/** A headset as its browser tells it. */
export interface HeadsetDevice {
  /** Distance of the two views' places, to a millimetre. */ readonly eye_distance_m: number;
  /** Name of its controllers' kind, by the registry of WebXR; `unknown` where they tell none. */ readonly profile: string;
  readonly views: readonly HeadsetView[];
}

/** The view of one eye: its pixels, and the part of the world that it shows. */
export interface HeadsetView {
  readonly eye: "left" | "right" | "none";
  readonly size_px: readonly [number, number];
  /** Tangents of the angles from straight ahead to its left, right, lower and upper edge: left and down are below 0. */ readonly tangents: readonly [number, number, number, number];
}

/** Machine as the gate found it: nothing that tells one person from another. */
export interface Machine {
  /** Name and main version. */ readonly browser: string;
  readonly color_gamut: "srgb" | "p3" | "rec2020" | "unknown";
  readonly device_pixel_ratio: number;
  readonly full_screen: boolean;
  /** The headset. Left out where the study ran on a screen. */ readonly headset: HeadsetDevice | null;
  /** Share of the refreshes of that measurement. */ readonly missed_share: number;
  /** Measured, over at least 300 frames. */ readonly refresh_hz: number;
  /** Screen pixels per pixel of a stimulus, along an edge. */ readonly scale: number;
  /** True if no person took part: an artificial observer drove the page. */ readonly simulated: boolean;
  readonly touch: boolean;
  /** Device pixels of the canvas. */ readonly window_px: readonly [number, number];
}

/** A remark by the page, such as a file that was not the one that was hashed. */
export interface NoteLine extends Sent {
  readonly kind: "note";
  readonly text: string;
}

/** A pause, sent at its end. */
export interface PauseLine extends Sent {
  readonly duration_s: number;
  readonly kind: "pause";
}

/** A key, or the pointer, in an attempt. */
export interface Press {
  /** Time on the page's clock. */ readonly at_us: number;
  /** Number of the flip after which it was read. */ readonly flip: number;
  readonly key: string;
  /** Place of the pointer across the study's screen. */ readonly x: number | null;
}

/** The page was opened again for the same participant. */
export interface ResumeLine extends Sent {
  /** Opening of the page that wrote the line before. Null in lines of older pages. */ readonly continues: number | null;
  readonly kind: "resume";
  readonly machine: Machine;
  /** Refresh rate that is used from here on, of those of the study. */ readonly rate_hz: number;
}

/** The first line of a participant. */
export interface StartLine extends Sent {
  readonly format: 1;
  /** Value of the link's parameter that the study names. */ readonly identifier: string | null;
  readonly kind: "start";
  readonly language: string;
  readonly machine: Machine;
  readonly manifest_sha256: string;
  /** Key of the export, by which the slot's place in the counterbalancing is drawn. Null: places are not drawn, or by the seed, as in exports of older versions. */ readonly places_key: number | null;
  readonly protocol_sha256: string;
  /** Refresh rate that is used, of those of the study. */ readonly rate_hz: number;
  /** Revision of metamerlab, which made the export. */ readonly revision: string;
  /** Drawn by the browser. */ readonly seed: number;
  readonly slot: number;
  readonly slot_from: "link" | "batch" | "drawn";
  /** Hash of the export's `study.json`. */ readonly study_file_sha256: string;
}

export type WebLine = StartLine | ResumeLine | ConsentLine | BlockStartLine | BlockEndLine | BreakLine | PauseLine | AttemptLine | AnswerLine | NoteLine | EndLine;
