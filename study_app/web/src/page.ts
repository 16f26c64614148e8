/** The page of an exported folder: runs the study at once, in JATOS where that is there. */
import { run } from "./main";
import type { Jatos } from "./store/stores";

const { jatos } = globalThis as { jatos?: Jatos };
if (jatos) {
  jatos.onLoad(() => {
    void run({ jatos });
  });
} else {
  void run();
}
