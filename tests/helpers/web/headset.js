// A headset that is made up (iwer), on a head that holds still, with two controllers that answer by chance.
// window.headset = { device, kind, press: a button of a hand for one refresh, answers: false: it
// does not press in trials, each: called as a phase begins, with its name and the attempt's number,
// stays: likewise, at its later refreshes, leaves: pages at which it leaves, canvas_px: of both
// views, reads_ms, pages: those that were read in it }
(() => {
  const kind = window.HEADSET ?? "oculusQuest1";
  const device = new IWER.XRDevice(IWER[kind]);
  device.installRuntime({ forceInstall: true });
  device.stereoEnabled = true;
  device.position.set(0, 1.6, 0);
  const headset = (window.headset = { device, kind, answers: true, each: null, leaves: [], canvas_px: [128, 64], reads_ms: 100, pages: [] });
  // A software renderer does not come after as fast as virtual time passes: views are small.
  const small = () => {
    const canvas = document.querySelector("canvas"), [width, height] = headset.canvas_px;
    if (canvas && canvas.width !== width) Object.assign(canvas, { width, height });
  };
  new MutationObserver(small).observe(document, { childList: true, subtree: true, attributes: true });
  let held = [], was, since = 0, page, due = null, attempts = 0;
  headset.press = (hand, button = "trigger") => {
    device.controllers[hand].updateButtonValue(button, 1);
    held.push([hand, button]);
  };
  observer.answer = null;
  observer.each = () => {
    const { page: now_page, phase } = document.querySelector("canvas")?.dataset ?? {};
    if (held.length) {
      for (const [hand, button] of held) device.controllers[hand].updateButtonValue(button, 0);
      held = [];
      return;
    }
    if (now_page !== page) [page, since] = [now_page, clock.now];
    if (page && clock.now - since > headset.reads_ms) {
      if (headset.pages.at(-1) !== page) headset.pages.push(page);
      since = clock.now;
      headset.press("right", headset.leaves.includes(page) ? "squeeze" : "trigger");
    }
    if (phase && phase === was) headset.stays?.(phase, attempts);
    if (phase !== was) {
      was = phase;
      if (phase === "fixate") attempts += 1;
      if (phase) headset.each?.(phase, attempts);
      due = phase && headset.answers && keys?.[phase] ? clock.now + 40 + 100 * drawn() : null;
    }
    if (due !== null && clock.now >= due) {
      due = null;
      headset.press(drawn() < 0.5 ? "left" : "right");
    }
  };
})();
