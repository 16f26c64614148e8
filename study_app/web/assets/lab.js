// A lab's own screens around a study: consent and a questionnaire before it, a question after it.
// Copy this file and lab.html, and change what they say. Any plugin of jsPsych 8 can be used. JATOS keeps
// what these screens collect as files "jspsych.json"; elsewhere, give runInJsPsych a function `keep`.
const CONSENT = `
<h1>What this study stores</h1>
<p>Your answers, and when you gave them. A code that is drawn by chance, and no name. The kind and version of your
browser, the size of its window, how often your screen refreshes, and whether it was a touch screen. What you type
into the boxes before and after the study.</p>
<p>It stores no cookies of ours, no address of your computer, and no position. The server through which the study
comes may keep a list of addresses: ask the researchers.</p>
<p>You may stop at any time. Who leaves the study is offered to delete all answers.</p>`;

/** A page of a lab's own: a form, whose fields become data. */
class Form {
  static info = { name: "form", version: "1", parameters: { html: {}, button: {} }, data: {} };

  constructor(jsPsych) {
    this.jsPsych = jsPsych;
  }

  trial(element, { html, button }) {
    element.innerHTML = `<form class="lab">${html}<p><button>${button}</button></p></form>`;
    const form = element.querySelector("form");
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.jsPsych.finishTrial({ fields: Object.fromEntries(new FormData(form)) });
    });
  }
}

const before = [
  { type: Form, html: CONSENT, button: "I agree" },
  { type: Form, html: '<p><label>Your age <input name="age" type="number" min="18" required></label></p>', button: "Continue" },
];
const after = [
  { type: Form, html: '<p><label>Was anything odd? <input name="odd"></label></p>', button: "Continue" },
];

const start = () => metamerlab.runInJsPsych({ jatos: globalThis.jatos, before, after });
if (globalThis.jatos) jatos.onLoad(start);
else start();
