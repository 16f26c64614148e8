// A virtual display for tests: a frame lasts one refresh of virtual time, whatever the machine does,
// and nobody waits: where no frame is asked for, time jumps to the next timer.
// window.clock = { hz, drop: numbers of frames that last two refreshes, each: called before a frame }
(() => {
  let now = 1000, frame = 0, frames = [], timers = [], id = 0;
  const clock = (window.clock = {
    hz: 60, drop: new Set(), each: null, get now() { return now; }, get frame() { return frame; },
  });
  performance.now = () => now;
  Object.defineProperty(Event.prototype, "timeStamp", { get: () => now });
  window.requestAnimationFrame = (call) => { frames.push([++id, call]); return id; };
  window.cancelAnimationFrame = (number) => { frames = frames.filter(([one]) => one !== number); };
  const later = window.setTimeout.bind(window);
  window.setTimeout = (call, wait_ms = 0, ...rest) => {
    timers.push({ id: ++id, due: now + Math.max(0, wait_ms), call: () => call(...rest) });
    return id;
  };
  window.clearTimeout = (number) => { timers = timers.filter((one) => one.id !== number); };
  const due = () => {
    const over = timers.filter((one) => one.due <= now).sort((a, b) => a.due - b.due);
    timers = timers.filter((one) => one.due > now);
    for (const one of over) one.call();
  };
  const { port1, port2 } = new MessageChannel();
  let idle = 0;
  port1.onmessage = () => {
    clock.each?.(frames.length > 0);
    if (frames.length) {
      idle = 0;
      now += ((clock.drop.has(++frame) ? 2 : 1) * 1000) / clock.hz;
      const calls = frames;
      frames = [];
      for (const [, call] of calls) call(now);
      due();
      port2.postMessage(0);
    } else {
      // Files and servers answer in real time: give them some before a timer is taken for the next.
      if (++idle > 20 && timers.length) { now = Math.max(now, Math.min(...timers.map((one) => one.due))); idle = 0; }
      due();
      later(() => port2.postMessage(0), 2);
    }
  };
  port2.postMessage(0);
})();
