/** Texts of the page itself for participants, in their language; the study's texts come with it. */
const EN = {
  start: "Start in full screen",
  resume: "Go on in full screen",
  next: "Continue",
  agree: "I agree",
  leave: "Leave",
  stay: "Stay",
  wait: "Please wait.",
  measuring: "Measuring the screen. Please leave the window as it is.",
  loading: "Loading: {done} %",
  window: "This window is too small. It must be at least {width} x {height} pixels (it is {got}). Make it larger, or set the zoom of the page to 100 %.",
  phone: "This study needs a computer with a keyboard and a larger screen. Please open the link there.",
  rate: "This study runs at {rates} refreshes a second (this screen has {got}). Please choose another screen, or another refresh rate in the settings of the system.",
  insecure: "This page must come over https, so that the browser can check its files.",
  memory: "This device has too little memory for this study. Please use another computer.",
  broken: "Something went wrong: {why}",
  saving: "Sending your answers.",
  unsent: "Your answers could not be sent. Please save this file, and send it to the researchers.",
  save: "Save my answers",
  over: "This session is over. You may close the window.",
  code: "Your completion code: {code}",
  go: "Back to the panel",
  slow: "The line is slow. The next pictures are still on their way; please wait.",
  busy: "This study is open in another tab or window. Go on there, or close it.",
  here: "Go on here",
  moved: "The study goes on in another tab or window. You may close this one.",
  down: "The connection is down. This page tries again for some minutes; please wait.",
  again: "To go on, open this link again: what you have done is kept.",
  left: "You have left the study. To go on, open its link again.",
  withdraw: "Withdraw: delete all my answers",
  withdrawn: "All your answers were deleted. You may close the window.",
};
export type Words = typeof EN;

const DE: Words = {
  start: "Im Vollbild beginnen",
  resume: "Im Vollbild weitermachen",
  next: "Weiter",
  agree: "Ich stimme zu",
  leave: "Beenden",
  stay: "Weitermachen",
  wait: "Bitte warten.",
  measuring: "Der Bildschirm wird gemessen. Bitte lassen Sie das Fenster, wie es ist.",
  loading: "Lädt: {done} %",
  window: "Dieses Fenster ist zu klein. Es muss mindestens {width} x {height} Pixel haben (es hat {got}). Vergrößern Sie es, oder stellen Sie den Zoom der Seite auf 100 %.",
  phone: "Diese Studie braucht einen Computer mit Tastatur und einen größeren Bildschirm. Bitte öffnen Sie den Link dort.",
  rate: "Diese Studie läuft mit {rates} Bildern pro Sekunde (dieser Bildschirm hat {got}). Bitte wählen Sie einen anderen Bildschirm oder eine andere Bildfrequenz.",
  insecure: "Diese Seite muss über https kommen, damit der Browser ihre Dateien prüfen kann.",
  memory: "Dieses Gerät hat zu wenig Speicher für diese Studie. Bitte benutzen Sie einen anderen Computer.",
  broken: "Etwas ist schiefgegangen: {why}",
  saving: "Ihre Antworten werden gesendet.",
  unsent: "Ihre Antworten konnten nicht gesendet werden. Bitte speichern Sie diese Datei, und schicken Sie sie an die Forscher.",
  save: "Meine Antworten speichern",
  over: "Diese Sitzung ist beendet. Sie können das Fenster schließen.",
  code: "Ihr Abschlusscode: {code}",
  go: "Zurück zum Panel",
  slow: "Die Leitung ist langsam. Die nächsten Bilder sind noch unterwegs; bitte warten Sie.",
  busy: "Diese Studie ist in einem anderen Tab oder Fenster offen. Machen Sie dort weiter, oder schließen Sie es.",
  here: "Hier weitermachen",
  moved: "Die Studie geht in einem anderen Tab oder Fenster weiter. Dieses können Sie schließen.",
  down: "Die Verbindung ist unterbrochen. Diese Seite versucht es einige Minuten lang wieder; bitte warten Sie.",
  again: "Um weiterzumachen, öffnen Sie diesen Link noch einmal: Was Sie getan haben, bleibt erhalten.",
  left: "Sie haben die Studie verlassen. Um weiterzumachen, öffnen Sie ihren Link noch einmal.",
  withdraw: "Zurücktreten: alle meine Antworten löschen",
  withdrawn: "Alle Ihre Antworten wurden gelöscht. Sie können das Fenster schließen.",
};

export function wordsOf(language: string): Words {
  return language.split("-")[0] === "de" ? DE : EN;
}

/** A text with its placeholders replaced. */
export function filled(text: string, values: Readonly<Record<string, string | number>>): string {
  return text.replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));
}
