/** Texts of a headset's page, and pictures of texts that are read in it. */
import type { Words } from "./words";

const PAGE_PX: readonly [number, number] = [1024, 768];
/** Distance of a page in its pixels, so that it is 40 degrees wide. */
export const PAGE_DISTANCE_PX = 1407;
const [FONT_PX, LINE_PX, EDGE_PX] = [34, 46, 40];

export interface HeadsetWords {
  /** In place of the screen's. */
  readonly page: Partial<Words>;
  /** Buttons that are used. */
  readonly keys: readonly string[];
  /** Steps before the headset goes on. */
  readonly before: readonly string[];
  readonly test: string;
  readonly goes: string;
  readonly agrees: string;
  readonly stays: string;
}

const EN: HeadsetWords = {
  page: {
    start: "Start in the headset",
    resume: "Go on in the headset",
    about: "about {minutes} min, in a headset",
    phone: "This study needs a headset with two controllers. Please open the link in the headset's own browser.",
    measuring: "Measuring the headset. Please wait.",
    rate: "This study runs at {rates} refreshes a second (this headset has {got}). Please choose another rate in its settings.",
    fullScreen: "The headset is off. Press this button in the headset's browser to go on in it. Nothing counts until then.",
    storedWhat:
      "Your answers, the buttons that you press, when, and where your head points during trials. Of the headset: name and version of the browser, kind of controllers, refresh rate, size of the pictures, distance of the lenses. No name, no address.",
  },
  keys: ["Left trigger: the answer on the left.", "Right trigger: the answer on the right.", "A trigger goes on.", "A grip pauses or leaves."],
  before: [
    "Before you put the headset on: sit on a chair that does not turn, with free space around you, and take one controller in each hand. Clean the lenses. Set their distance to that of your eyes.",
    "If you feel dizzy or sick, take the headset off at once. You can go on later with this link, or stop.",
    "Look straight ahead as you start. A test picture comes first.",
  ],
  test: "Is this text sharp from its first to its last line?\n\nIf not, move the headset up or down on your face, tighten its strap, or set the distance of the lenses.\n\na c e m n o r s u v w x z",
  goes: "Trigger: go on      Grip: leave",
  agrees: "Trigger: I agree      Grip: leave",
  stays: "Trigger: stay      Grip: leave",
};

const DE: HeadsetWords = {
  page: {
    start: "Im Headset beginnen",
    resume: "Im Headset weitermachen",
    about: "etwa {minutes} Min., in einem Headset",
    phone: "Diese Studie braucht ein Headset mit zwei Controllern. Bitte öffnen Sie den Link im Browser des Headsets.",
    measuring: "Das Headset wird gemessen. Bitte warten.",
    rate: "Diese Studie läuft mit {rates} Bildern pro Sekunde (dieses Headset hat {got}). Bitte wählen Sie in seinen Einstellungen eine andere Bildfrequenz.",
    fullScreen: "Das Headset ist aus. Drücken Sie diesen Knopf im Browser des Headsets, um darin weiterzumachen. Bis dahin zählt nichts.",
    storedWhat:
      "Ihre Antworten, die Knöpfe, die Sie drücken, wann, und wohin Ihr Kopf während der Durchgänge zeigt. Vom Headset: Name und Version des Browsers, Art der Controller, Bildfrequenz, Größe der Bilder, Abstand der Linsen. Kein Name, keine Adresse.",
  },
  keys: ["Linker Abzug: die linke Antwort.", "Rechter Abzug: die rechte Antwort.", "Ein Abzug geht weiter.", "Ein Griff macht Pause oder beendet."],
  before: [
    "Bevor Sie das Headset aufsetzen: Setzen Sie sich auf einen Stuhl, der sich nicht dreht, mit freiem Platz um Sie, und nehmen Sie in jede Hand einen Controller. Reinigen Sie die Linsen. Stellen Sie ihren Abstand auf den Ihrer Augen ein.",
    "Wird Ihnen schwindlig oder übel, so nehmen Sie das Headset sofort ab. Sie können später mit diesem Link weitermachen oder aufhören.",
    "Blicken Sie beim Beginn geradeaus. Zuerst kommt ein Testbild.",
  ],
  test: "Ist dieser Text von der ersten bis zur letzten Zeile scharf?\n\nWenn nicht, schieben Sie das Headset höher oder tiefer, ziehen Sie das Band fester, oder stellen Sie den Abstand der Linsen ein.\n\na c e m n o r s u v w x z",
  goes: "Abzug: weiter      Griff: beenden",
  agrees: "Abzug: Ich stimme zu      Griff: beenden",
  stays: "Abzug: weitermachen      Griff: beenden",
};

export function headsetWordsOf(language: string): HeadsetWords {
  return language.split("-")[0] === "de" ? DE : EN;
}

/** A picture of a page: its text, what buttons do, how much is done. Its rows go up. */
export function textPage(text: string, hint: string | null, share: number, background: number): OffscreenCanvas {
  const [width, height] = PAGE_PX;
  const page = new OffscreenCanvas(width, height);
  const context = page.getContext("2d", { alpha: false });
  if (!context) throw new Error("this browser draws on no canvas");
  context.setTransform(1, 0, 0, -1, 0, height);
  context.fillStyle = `rgb(${background} ${background} ${background})`;
  context.fillRect(0, 0, width, height);
  context.fillStyle = background > 100 ? "black" : "white";
  if (share > 0) context.fillRect(EDGE_PX, EDGE_PX / 2, share * (width - 2 * EDGE_PX), 6);
  const linesAt = (size_px: number) => {
    context.font = `${size_px}px sans-serif`;
    return text.split("\n").flatMap((line) => wrapped(context, line, width - 2 * EDGE_PX));
  };
  let size_px = FONT_PX;
  while (size_px > 14 && (linesAt(size_px).length + 3) * LINE_PX * size_px > height * FONT_PX) size_px -= 2;
  const lines = linesAt(size_px);
  const line_px = (LINE_PX * size_px) / FONT_PX;
  lines.forEach((line, row) => {
    context.fillText(line, EDGE_PX, 2 * EDGE_PX + row * line_px);
  });
  if (hint !== null) context.fillText(hint, EDGE_PX, height - EDGE_PX);
  return page;
}

function wrapped(context: OffscreenCanvasRenderingContext2D, text: string, width: number): string[] {
  const lines: string[] = [];
  let line = "";
  for (const word of text.split(" ")) {
    const longer = line ? `${line} ${word}` : word;
    if (line && context.measureText(longer).width > width) {
      lines.push(line);
      line = word;
    } else line = longer;
  }
  return [...lines, line];
}
