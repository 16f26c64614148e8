/** Drives Firefox for Python's tests, over BiDi: an order and an answer are a JSON line each.
 *
 * `tests/helpers/chromium.py` drives Chromium.
 */
import { createInterface } from "node:readline";
import { launch, type Browser, type BrowserContext, type Page } from "puppeteer-core";

interface Orders {
  launch: { path: string };
  /** Open a page, whose scripts run before its own; `anew` as in a browser that was never here. */
  open: { url: string; scripts: string[]; size: [number, number]; anew: boolean };
  /** Give the page another size. */
  resize: { size: [number, number] };
  evaluate: { script: string };
  close: object;
  /** Turn to the tab that was put aside, and put this one aside. */
  swap: object;
  /** Errors in the page so far. */
  errors: object;
  quit: object;
}
type Order = { [K in keyof Orders]: { order: K } & Orders[K] }[keyof Orders];

let browser: Browser | null = null;
let context: BrowserContext | null = null;
let page: Page | null = null;
let aside: Page | null = null;
let errors: string[] = [];

function there<T>(what: T | null): T {
  if (what === null) throw new Error("there is no browser, or no page in it");
  return what;
}

async function close(): Promise<void> {
  await page?.close({ runBeforeUnload: false });
  page = null;
}

async function obey(order: Order): Promise<unknown> {
  switch (order.order) {
    case "launch":
      browser = await launch({
        browser: "firefox",
        executablePath: order.path,
        headless: true,
        defaultViewport: null,
      });
      return browser.version();
    case "open": {
      const { size, anew } = order;
      await close();
      if (anew) await context?.close();
      if (anew || !context) context = await there(browser).createBrowserContext();
      page = await context.newPage();
      errors = [];
      await page.setViewport({ width: size[0], height: size[1] });
      page.on("pageerror", (error) => errors.push(String(error)));
      for (const script of order.scripts) await page.evaluateOnNewDocument(script);
      await page.goto(order.url);
      return null;
    }
    case "resize":
      return there(page).setViewport({ width: order.size[0], height: order.size[1] });
    case "evaluate":
      return there(page).evaluate(order.script);
    case "swap":
      [page, aside] = [aside, page];
      return null;
    case "close":
      return close();
    case "errors":
      return errors;
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
