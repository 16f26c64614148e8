// A virtual display: a frame lasts one refresh of virtual time, whatever the machine does, and nobody
// waits: where no frame is asked for, time jumps to the next timer.
// window.clock = { hz, drop: numbers of frames that last two refreshes, each: called as a frame is
// shown (true) or while none is asked for (false), patience_ms: real time after which a file or
// server that does not answer is taken for slow }
(() => {
  const EPOCH = Date.UTC(2000, 0, 1), RealDate = Date, start = 1000;
  let now = start, frame = 0, frames = [], timers = [], id = 0, pending = 0;
  const clock = (window.clock = {
    hz: 60, drop: new Set(), each: null, patience_ms: Infinity,
    get now() { return now; }, get frame() { return frame; },
  });
  performance.now = () => now;
  window.Date = class extends RealDate {
    constructor(...of) { if (of.length) super(...of); else super(EPOCH + now); }
    static now() { return EPOCH + now; }
  };
  Object.defineProperty(Event.prototype, "timeStamp", { get: () => now });
  window.requestAnimationFrame = (call) => { frames.push([++id, call]); return id; };
  window.cancelAnimationFrame = (number) => { frames = frames.filter(([one]) => one !== number); };
  const later = window.setTimeout.bind(window);
  window.setTimeout = (call, wait_ms = 0, ...rest) => {
    timers.push({ id: ++id, due: now + Math.max(0, wait_ms), call: () => call(...rest) });
    return id;
  };
  window.clearTimeout = (number) => { timers = timers.filter((one) => one.id !== number); };
  const idle = { since: RealDate.now() };
  const counted = (call) => async (...of) => {
    pending += 1;
    try { return await call(...of); } finally { pending -= 1; idle.since = RealDate.now(); }
  };
  const fetched = window.fetch.bind(window);
  window.fetch = counted(async (...of) => {
    const answer = await fetched(...of);
    return new Response(await answer.arrayBuffer(), { status: answer.status, headers: answer.headers });
  });
  window.createImageBitmap = counted(window.createImageBitmap.bind(window));
  if (crypto.subtle) crypto.subtle.digest = counted(crypto.subtle.digest.bind(crypto.subtle));
  // Timers fire at their time, as they would between two frames.
  const pass = (until) => {
    for (;;) {
      const next = timers.reduce((least, one) => (!least || one.due < least.due ? one : least), null);
      if (!next || next.due > until) break;
      timers = timers.filter((one) => one !== next);
      now = Math.max(now, next.due);
      next.call();
    }
    now = Math.max(now, until);
  };
  const { port1, port2 } = new MessageChannel();
  const BREATH_MS = 12; // what the page does of itself, such as laying out, takes real time, too
  port1.onmessage = () => {
    if (frames.length) {
      pass(now + ((clock.drop.has(++frame) ? 2 : 1) * 1000) / clock.hz);
      clock.each?.(true);
      const calls = frames;
      frames = [];
      for (const [, call] of calls) call(now);
      idle.since = RealDate.now();
      port2.postMessage(0);
    } else {
      clock.each?.(false);
      const waits_ms = pending ? clock.patience_ms : BREATH_MS;
      if (timers.length && RealDate.now() - idle.since > waits_ms) {
        pass(Math.max(now, Math.min(...timers.map((one) => one.due))));
        idle.since = RealDate.now();
      }
      later(() => port2.postMessage(0), 2);
    }
  };
  port2.postMessage(0);
})();
