/** The page of an exported folder: runs the study at once, in JATOS where that is there. */
import { run } from "./main";
import type { Jatos } from "./store/stores";

/** From now on no inline script runs. Before, jatos.js needs them: its jQuery adds two of its parts so. */
function forbidInline(): void {
  const policy = document.createElement("meta");
  policy.httpEquiv = "Content-Security-Policy";
  policy.content = "script-src 'self'";
  document.head.append(policy);
}

const { jatos } = globalThis as { jatos?: Jatos };
if (jatos) {
  jatos.onLoad(() => {
    forbidInline();
    void run({ jatos });
  });
} else {
  forbidInline();
  void run();
}
