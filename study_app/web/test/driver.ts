/** Drives Chromium and Firefox for Python's tests: an order and an answer are a JSON line each. */
import { createInterface } from "node:readline";
import { launch, type Browser, type Page } from "puppeteer-core";

interface Orders {
  launch: { browser: "chrome" | "firefox"; path: string; args: string[]; prefs: Record<string, unknown> };
  /** Open a page with storage of its own, whose scripts run before its own; without a size, in the
   * window as it is. */
  open: { url: string; scripts: string[]; size: [number, number] | null };
  goto: { url: string };
  evaluate: { script: string };
  /** Ask until the answer is true, or time is over; the last answer. */
  until: { script: string; timeout_s: number };
  press: { key: string };
  click: { selector: string };
  /** The composited page, as PNG in base 64. */
  screenshot: object;
  /** Of Chromium only. */
  devtools: { method: string; params: Record<string, unknown> };
  /** End the tab as a participant does, or its process, as a machine does. */
  kill: { crash: boolean };
  /** What went wrong in pages since the last time. */
  errors: object;
  quit: object;
}
type Order = { [K in keyof Orders]: { order: K } & Orders[K] }[keyof Orders];

let browser: Browser | null = null;
let page: Page | null = null;
let errors: string[] = [];

function there<T>(what: T | null): T {
  if (what === null) throw new Error("there is no browser, or no page in it");
  return what;
}

function pause(wait_ms: number): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, wait_ms));
}

async function kill(crash: boolean): Promise<void> {
  const dying = there(page);
  page = null;
  if (crash) {
    const session = await dying.createCDPSession();
    const dead = new Promise((resolve) => dying.once("error", resolve));
    session.send("Page.crash").catch(() => undefined); // nobody is left to answer
    await Promise.race([dead, pause(2000)]);
  }
  await dying.close({ runBeforeUnload: false });
}

async function obey(order: Order): Promise<unknown> {
  switch (order.order) {
    case "launch": {
      const { browser: kind, path, args, prefs } = order;
      browser = await launch({
        browser: kind,
        executablePath: path,
        headless: true,
        args,
        extraPrefsFirefox: prefs,
        defaultViewport: null,
        ...(kind === "chrome" ? { pipe: true } : {}),
      });
      return browser.version();
    }
    case "open": {
      if (page) await kill(false);
      const { size } = order;
      page = await (size ? await there(browser).createBrowserContext() : there(browser)).newPage();
      if (size) await page.setViewport({ width: size[0], height: size[1] });
      page.on("pageerror", (error) => errors.push(String(error)));
      for (const script of order.scripts) await page.evaluateOnNewDocument(script);
      await page.goto(order.url);
      return null;
    }
    case "goto":
      await there(page).goto(order.url);
      return null;
    case "evaluate":
      return there(page).evaluate(order.script);
    case "until": {
      const end_ms = Date.now() + order.timeout_s * 1000;
      for (;;) {
        const told = await there(page).evaluate(order.script);
        if (told || Date.now() > end_ms) return told;
        await pause(50);
      }
    }
    case "press":
      await there(page).keyboard.press(order.key as "Enter");
      return null;
    case "click":
      await there(page).click(order.selector);
      return null;
    case "screenshot":
      return there(page).screenshot({ encoding: "base64", captureBeyondViewport: false });
    case "devtools": {
      const session = await there(page).createCDPSession();
      return session.send(order.method as "Page.enable", order.params);
    }
    case "kill":
      return kill(order.crash);
    case "errors": {
      const told = errors;
      errors = [];
      return told;
    }
    case "quit":
      await browser?.close();
      return null;
  }
}

for await (const line of createInterface({ input: process.stdin })) {
  let told: unknown;
  try {
    told = { answer: (await obey(JSON.parse(line) as Order)) ?? null };
  } catch (error) {
    told = { error: String(error) };
  }
  process.stdout.write(JSON.stringify(told) + "\n");
}
