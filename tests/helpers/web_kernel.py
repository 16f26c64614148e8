"""The kernel in TypeScript, asked by Python: a process of Node that answers line by line."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

WEB = Path(__file__).resolve().parents[2] / "study_app" / "web"


def needed(name: str, found: object) -> None:
    """Skip where a tool of the web part is missing; fail where it must be there."""
    if found:
        return
    why = f"{name} is not here: script/setup --tools installs it"
    if os.environ.get("REQUIRE_WEB") == "1":
        pytest.fail(why)
    pytest.skip(why)


def node_modules() -> Path:
    """Return the folder of Node's packages, as the lock file says."""
    needed("Node", shutil.which("node"))
    modules = WEB / "node_modules"
    needed("the web part's node_modules", (modules / "esbuild").is_dir())
    return modules


class Kernel:
    """Questions to the kernel; an answer is plain JSON."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def ask(self, what: str, **said: Any) -> Any:
        """Return the answer; `AssertionError` with its words where the kernel refuses."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps({"ask": what, **said}) + "\n")
        self.process.stdin.flush()
        told = json.loads(self.process.stdout.readline())
        assert "error" not in told, told["error"]
        return told["answer"]


@contextmanager
def running_kernel(folder: Path) -> Iterator[Kernel]:
    """Build the kernel into a folder and run it until the block ends."""
    esbuild = node_modules() / ".bin" / "esbuild"
    script = folder / "twin.mjs"
    subprocess.run(
        [esbuild, "test/twin.ts", "--bundle", "--platform=node", "--format=esm",
         "--log-level=warning", f"--outfile={script}"],
        cwd=WEB, check=True, timeout=60,
    )  # fmt: skip
    with subprocess.Popen(
        ["node", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield Kernel(process)
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(timeout=10) == 0
