// An artificial observer: reads and turns pages, and presses a key for every question that it is shown.
// window.observer = { answer: from the name of a phase to a key and its reaction time in ms, or null,
// each: called before anything, leave: pages that it leaves, text: what it types, reads_ms }
(() => {
  const NAMED = {
    left: "ArrowLeft", right: "ArrowRight", up: "ArrowUp", down: "ArrowDown", space: " ",
    enter: "Enter", escape: "Escape", tab: "Tab", backspace: "Backspace",
  };
  const observer = (window.observer = {
    answer: null, each: null, leave: [], text: "simulated", reads_ms: 2000, pages: [],
  });
  observer.press = (name) => {
    const [, pad] = /^kp_(\d)$/.exec(name) ?? [];
    const key = NAMED[name] ?? pad ?? (/^f\d/.test(name) ? name.toUpperCase() : name);
    dispatchEvent(new KeyboardEvent("keydown", { key, code: pad ? `Numpad${pad}` : "", cancelable: true }));
  };
  // Nobody looks: what is painted need not reach a screen, which takes most of the time.
  addEventListener("DOMContentLoaded", () => {
    const style = new CSSStyleSheet(); // an element with a style is forbidden in the page
    style.replaceSync("canvas { opacity: 0 }");
    document.adoptedStyleSheets = [style];
  });
  let was, waiting = [];
  const watch = () => {
    const phase = document.querySelector("canvas")?.dataset.phase;
    if (phase === was) return;
    was = phase;
    if (phase === undefined) { // the attempt is over
      waiting.forEach(clearTimeout);
      waiting = [];
    }
    const [key, after_ms] = (phase && observer.answer?.(phase)) ?? [];
    if (key) waiting.push(setTimeout(() => observer.press(key), after_ms));
  };
  const read = (main) => {
    const leaves = observer.leave.includes(main.dataset.page);
    const button = main.querySelector(leaves ? "button.leave" : "button:not(.withdraw, .other)");
    if (!button || button.disabled || button.seen) return;
    button.seen = true;
    setTimeout(() => {
      const text = main.querySelector("textarea"), choice = main.querySelector("input[type=radio]");
      if (text && !text.value) text.value = observer.text;
      if (choice) choice.checked = true;
      observer.pages.push(main.dataset.page);
      button.click();
    }, observer.reads_ms);
  };
  clock.each = (frames) => {
    observer.each?.(frames);
    const main = document.querySelector("main");
    watch();
    if (!frames && main && !main.hidden) read(main);
  };
})();
