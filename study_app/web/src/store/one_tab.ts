/** One tab of a browser at a time goes on with a session: the others wait. No other device knows. */

/** Time in which a tab answers that has a link; counts only where a browser has no locks. */
const ANSWERS_MS = 500;

export interface Hold {
  /** Another tab had the link: what was read before is old. */
  readonly waited: boolean;
  /** Let another tab go on. */
  release(): void;
}

/** Wait until no other tab has a link.
 *
 * `waits` gets what asks the other tab to let go; `leaves` is done before this one does.
 */
export async function holdLink(
  name: string,
  waits: (ask: () => void) => void,
  leaves: () => Promise<void>,
): Promise<Hold> {
  const channel = new BroadcastChannel(`metamerlab:${name}`);
  let waited = false;
  const busy = () => {
    if (waited) return;
    waited = true;
    waits(() => {
      channel.postMessage("let go");
    });
  };
  const free = "locks" in navigator ? await locked(channel.name, busy) : await agreed(channel, busy);
  const release = () => {
    channel.close();
    free();
  };
  channel.addEventListener("message", ({ data }) => {
    if (data === "let go") void leaves().then(release);
  });
  return { waited, release };
}

/** Take the browser's lock, which ends with the page, however that ends; what gives it back. */
function locked(name: string, busy: () => void): Promise<() => void> {
  return new Promise((resolve) => {
    const hold = () => new Promise<void>(resolve);
    const first = (lock: Lock | null) => {
      if (lock) return hold();
      busy();
      return navigator.locks.request(name, hold);
    };
    navigator.locks.request(name, { ifAvailable: true }, first).catch(() => {
      resolve(() => undefined); // refused, as in a frame without rights: nobody waits
    });
  });
}

/** Ask until no tab says that it has the link; from then on say so. */
async function agreed(channel: BroadcastChannel, busy: () => void): Promise<() => void> {
  const pause = () => new Promise<boolean>((resolve) => setTimeout(resolve, ANSWERS_MS, false));
  for (;;) {
    const heard = new Promise<boolean>((resolve) => {
      channel.onmessage = ({ data }) => {
        if (data === "held") resolve(true);
      };
    });
    channel.postMessage("held?");
    if (!(await Promise.race([heard, pause()]))) break;
    busy();
    await pause();
  }
  channel.onmessage = ({ data }) => {
    if (data === "held?") channel.postMessage("held");
  };
  return () => {
    channel.onmessage = null;
  };
}
