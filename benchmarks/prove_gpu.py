"""The proof of a graphics card in one command: `script/prove-gpu`.

Runs on a bare machine with a driver and Python 3.11 or newer: without network, display or root.
OpenGL comes by EGL; no window is opened. First `metamerlab doctor`, then the tests that hold every
pass against its numpy twin, then what frames take (`script/bench gpu`). Each step runs in a process
of its own, so that a driver that crashes is a result, too. What has not run in time is named.

One JSON, DEVICE.json, is written after every step: in benchmarks/results/gpu for a graphics card,
from where `script/bench readme` takes it, and in out/prove-gpu for a software renderer. The exit
status is 0 where all is proven, 1 where something failed or did not run, and 2 where nothing can.
"""

# Nothing but Python may be imported here: this is what says which packages are missing.
from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FOR_TESTS = ("pytest", "pytest-timeout", "hypothesis")
TWINS = ("tests/twins", "tests/foveation", "tests/compression", "tests/textures")
WINDOWS = (
    "tests/twins/test_gl_context.py"
    "::test_a_windows_context_is_adopted_by_glx_and_by_egl_after_an_off_screen_one"
)
BENCHES = ("warp", "fill", "foveate", "textures")
SIZES_PX, QUICK_SIZES_PX = (1024, 2048, 4096), (128,)
LEAST_EDGE_PX, MOST_EDGE_PX = 64, 8192
MINUTES, TWINS_SHARE = 8.0, 0.5
REPEATS, QUICK_REPEATS = 9, 1
LEAST_STEP_S = 5.0  # a step that could only begin is not begun
MOST_WORKERS = 8
ROOM_BYTES = 1 << 20  # of results at most; asked for before minutes are spent


class CannotError(Exception):
    """Nothing can be proven here: what must hold, what was found, and the cure."""


@dataclass
class Proof:
    """Record of what was found so far, and where it is kept."""

    path: Path
    record: dict[str, Any]
    env: dict[str, str]
    work: Path
    ends_s: float
    failed: list[str] = field(default_factory=list)
    not_run: list[str] = field(default_factory=list)

    def left_s(self) -> float:
        """Time that is left."""
        return self.ends_s - time.monotonic()

    def keep(self) -> None:
        """Write the record, whole or not at all."""
        text = json.dumps(self.record | {"failed": self.failed, "not_run": self.not_run}, indent=1)
        text = text.replace(str(ROOT), "the checkout")  # where it lies is nobody's business
        part = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        try:
            with part.open("w", encoding="utf-8") as file:
                file.write(text + "\n")
                file.flush()
                os.fsync(file.fileno())
            part.replace(self.path)
        finally:
            part.unlink(missing_ok=True)


def main(argv: Sequence[str]) -> int:
    """Prove what can be proven here."""
    parser = argparse.ArgumentParser(
        prog="script/prove-gpu",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--quick", action="store_true", help="small frames, and no twins: seconds")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder of the results")
    parser.add_argument("--wheels", type=Path, metavar="DIR", help="take missing packages from it")
    parser.add_argument(
        "--sizes", type=_edge_px, nargs="+", metavar="PX", help="edges of the frames"
    )
    parser.add_argument(
        "--minutes", type=float, default=MINUTES, help=f"for all of it (default {MINUTES:g})"
    )
    arguments = parser.parse_args(argv)
    try:
        with tempfile.TemporaryDirectory(prefix="metamerlab-gpu-") as work:
            return prove(arguments, Path(work))
    except CannotError as error:
        _tell(f"error: {error}")
    except OSError as error:
        where = error.filename or tempfile.gettempdir()
        _tell(
            f"error: files must be written there: {where}"
            f" (found: {(error.strerror or str(error)).lower()}); make room, or set TMPDIR"
        )
    return 2


def prove(arguments: argparse.Namespace, work: Path) -> int:
    """Take every step; return the exit status.

    Raises
    ------
    CannotError, OSError
        If packages are missing, OpenGL is not there, or results cannot be written.
    """
    start_s = time.monotonic()
    site = work / "site"
    if lacking := missing(requirements()):
        if arguments.wheels is None:
            raise CannotError(missing_words(lacking))
        take_wheels(arguments.wheels.resolve(), requirements(), site)
    path = os.pathsep.join(filter(None, [str(site), str(ROOT), os.environ.get("PYTHONPATH")]))
    env = os.environ | {
        "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "CI": "true", "REQUIRE_GL": "1"
    }  # fmt: skip
    device = open_device(env)
    software = device["renderer"]["software"]
    usual = ROOT / ("out/prove-gpu" if software else "benchmarks/results/gpu")
    folder = (arguments.out or usual).resolve()
    proof = Proof(
        path=folder / f"{device_name(device['renderer']['name'])}.json",
        record={"minutes": arguments.minutes, "quick": arguments.quick, **device},
        env=env,
        work=work,
        ends_s=start_s + 60 * arguments.minutes,
    )
    reserve(folder)
    _tell(f"device: {device['renderer']['name']}, OpenGL {device['renderer']['version']}")
    doctor(proof)
    if not arguments.quick:
        twins(proof, most_s=60 * arguments.minutes * TWINS_SHARE)
    sizes_px = arguments.sizes or (QUICK_SIZES_PX if arguments.quick else SIZES_PX)
    frames(proof, sizes_px, QUICK_REPEATS if arguments.quick else REPEATS)
    proof.record["seconds"] = round(time.monotonic() - start_s, 1)
    proof.keep()
    _, table = run(proof.env, ["-m", "benchmarks", "gpu", "--show", str(proof.path)])
    print(table, end="")
    for line in proof.failed:
        _tell(f"failed: {line}")
    for line in proof.not_run:
        _tell(f"did not run: {line}")
    _tell(f"wrote {proof.path}")
    return 1 if proof.failed or proof.not_run else 0


def requirements() -> list[str]:
    """Packages that the checkout and its tests of the GPU need, as pyproject.toml names them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    tools = project["optional-dependencies"]["dev"]
    names = {re.split(r"[^\w.-]", line)[0]: line for line in tools}
    return [*project["dependencies"], *(names[name] for name in FOR_TESTS)]


def missing(needed: Iterable[str], folder: Path | None = None) -> dict[str, str]:
    """Packages that are not there in a fitting version, and what they need in turn.

    Parameters
    ----------
    needed : iterable of str
        As pyproject.toml writes them.
    folder : Path, optional
        Where to look before the places where Python looks.

    Returns
    -------
    dict
        What must hold (`moderngl>=5.12`) to what was found.
    """
    reader = _reader()
    path = [*([str(folder)] if folder else []), *sys.path]
    absent: dict[str, str] = {}
    pending, seen = [reader.Requirement(line) for line in needed], set()
    while pending:
        wanted = pending.pop(0)
        known = f"{wanted.name}{wanted.specifier}"
        if known in seen or (wanted.marker and not wanted.marker.evaluate({"extra": ""})):
            continue
        seen.add(known)
        found = next(iter(metadata.distributions(name=wanted.name, path=path)), None)
        if found is None:
            absent[known] = "not installed"
        elif not wanted.specifier.contains(found.version, prereleases=True):
            absent[known] = f"{found.version} is installed"
        else:
            pending += [reader.Requirement(line) for line in found.requires or ()]
    return absent


def _reader() -> Any:
    """Reader of requirements: its package, or the one inside pip."""
    try:
        from packaging import requirements as found
    except ImportError:
        try:
            from pip._vendor.packaging import requirements as found  # type: ignore[no-redef]
        except ImportError:
            raise CannotError(
                f"pip must be installed for {sys.executable} (found neither pip nor packaging);"
                " name another Python: PYTHON=/path/to/python3 script/prove-gpu"
            ) from None
    return found


def missing_words(lacking: dict[str, str], wheels: Path | None = None) -> str:
    """Say which packages are missing, and how to bring them."""
    found = "; ".join(f"{known}: {what}" for known, what in lacking.items())
    names = " ".join(f"'{known}'" for known in lacking)
    version = ".".join(map(str, sys.version_info[:2]))
    where = "" if wheels is None else f" or in {wheels}"
    return (
        f"these packages must be installed for {sys.executable}{where} (found {found}). Where there"
        f" is a network, run:\n  python3 -m pip download --only-binary=:all:"
        f" --python-version {version} --dest wheels {names}\nBring the folder here, then run:\n"
        "  script/prove-gpu --wheels wheels"
    )


def take_wheels(wheels: Path, needed: Sequence[str], target: Path) -> None:
    """Install what is missing from a folder of wheels into `target`, without a network.

    Raises
    ------
    CannotError
        If the folder lacks a package, too, or pip fails.
    """
    if not wheels.is_dir():
        raise CannotError(f"--wheels must be a folder of wheels (got {wheels}, which is none)")
    tried: set[str] = set()
    while lacking := missing(needed, target):
        if lacking.keys() <= tried:
            raise CannotError(missing_words(lacking, wheels))
        for known in lacking.keys() - tried:
            _install(known, wheels, target)
        tried |= lacking.keys()


def _install(known: str, wheels: Path, target: Path) -> None:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    command += ["--no-index", "--no-deps", "--no-compile", "--no-cache-dir", "--upgrade"]
    command += ["--find-links", str(wheels), "--target", str(target), known]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode and "No matching distribution" not in done.stderr:
        said = done.stderr.strip().splitlines() or ["nothing"]
        raise CannotError(f"pip must install {known} from {wheels} (it said: {said[-1]})")


def run(
    env: dict[str, str], command: Sequence[str], most_s: float | None = None
) -> tuple[int | None, str]:
    """Run Python; return its status, None where time ran out, and all that it said."""
    with subprocess.Popen(
        [sys.executable, *command],
        cwd=ROOT,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        errors="replace",
        start_new_session=True,  # its own processes end with it
    ) as process:
        try:
            said, _ = process.communicate(timeout=most_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return None, process.communicate()[0]
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    return process.returncode, said


def how_it_ended(status: int | None, said: str) -> str:
    """Say how a process ended that did not succeed, with its last line."""
    lines = [line for line in said.splitlines() if line.strip()]
    last = f": {lines[-1].strip()}" if lines else ""
    if status is None:
        return f"time ran out{last}"
    if status < 0:
        return f"the driver or a library crashed ({signal.Signals(-status).name}){last}"
    return f"status {status}{last}"


def open_device(env: dict[str, str]) -> dict[str, Any]:
    """Renderer, driver, versions and revision; a compute shader has worked.

    Raises
    ------
    CannotError
        If there is no OpenGL 4.3, or its compute shaders do not work.
    """
    status, said = run(env, ["-m", "benchmarks", "gpu", "--check"], 120.0)
    if status != 0:
        lines = said.strip().splitlines()
        if status == 2 and lines:
            raise CannotError(lines[-1].removeprefix("error: "))
        raise CannotError(
            "a picture must be copied by a compute shader first"
            f" ({how_it_ended(status, said)}); update the driver"
        )
    return dict(json.loads(said.splitlines()[-1]))


def device_name(renderer: str) -> str:
    """Name of a file for a renderer, without what it says of its buses and versions."""
    words = re.split(r"[/(]", renderer)[0].lower()
    return re.sub(r"[^a-z0-9]+", "-", words).strip("-") or "device"


def reserve(folder: Path) -> None:
    """Make the folder, and try whether results will fit.

    Raises
    ------
    CannotError
        If they will not.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(bytes(ROOM_BYTES))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise CannotError(
            f"{folder} must be a folder with room for 1 MiB of results"
            f" (found: {(error.strerror or str(error)).lower()}); make room, or name another: --out"
        ) from None


def doctor(proof: Proof) -> None:
    """Ask `metamerlab doctor` whether the machine is fit for stimuli."""
    command = ["-c", "import metamerlab; metamerlab.main()", "doctor", "--for", "stimuli", "--json"]
    status, said = run(proof.env, command, max(proof.left_s(), LEAST_STEP_S))
    try:
        found = json.loads(said[said.index("{") : said.rindex("}") + 1])
    except ValueError:
        proof.failed.append(f"doctor: {how_it_ended(status, said)}")
    else:
        proof.record["doctor"] = found
        proof.failed += [
            f"doctor: {one['check']}: {one['found']} ({one['cure']})"
            for one in found["findings"]
            if one["status"] == "FAIL"
        ]
    proof.keep()
    _tell("doctor done")


def twins(proof: Proof, most_s: float) -> None:
    """Hold every pass against its numpy twin."""
    start_s, lines = time.monotonic(), proof.work / "twins.jsonl"
    command = ["-m", "pytest", *TWINS, "-q", "-p", "no:cacheprovider", "--tb=no"]
    # A plug-in of the machine's that warns would end the run: warnings are errors here.
    command += ["-p", "benchmarks.twin_report", "-p", "no:benchmark", "--twins-to", str(lines)]
    if shutil.which("xvfb-run") is None:  # a window needs a screen, which a bare machine has not
        command += ["--deselect", WINDOWS]
    workers = min(MOST_WORKERS, os.cpu_count() or 1)
    if workers > 1 and not missing(["pytest-xdist"], proof.work / "site"):
        command += ["-n", str(workers)]
    status, said = run(proof.env, command, min(most_s, proof.left_s()))
    found = [json.loads(line) for line in lines.read_text().splitlines()] if lines.exists() else []
    names: list[str] = next((line["tests"] for line in found if "tests" in line), [])
    ended = {line["test"]: line for line in found if "test" in line and line["outcome"] != "failed"}
    ended |= {line["test"]: line for line in found if line.get("outcome") == "failed"}
    failed = [line for line in ended.values() if line["outcome"] == "failed"]
    left = [name for name in names if name not in ended]
    proof.record["twins"] = {
        "seconds": round(time.monotonic() - start_s, 1),
        "tests": len(names),
        **Counter(line["outcome"] for line in ended.values()),
        "failures": failed,
        "not_run": left,
    }
    proof.failed += [
        f"{line['test']}: largest difference {line.get('largest')}: {_first(line.get('says', ''))}"
        for line in failed
    ]
    files = Counter(name.partition("::")[0] for name in left)
    proof.not_run += [f"twins: {count} tests of {name}" for name, count in files.items()]
    if not names or (left and status is not None) or (status not in (0, 1, None)):
        proof.failed.append(f"twins: {how_it_ended(status, said)}")
    proof.keep()
    _tell(f"twins done: {len(names) - len(left)} of {len(names)} ran, {len(failed)} failed")


def frames(proof: Proof, sizes_px: Iterable[int], repeats: int) -> None:
    """Measure what frames take, bench by bench and size by size."""
    proof.record["rows"] = rows = []
    for size_px in sizes_px:
        for bench in BENCHES:
            name = f"{bench} at {size_px} px"
            if proof.left_s() < LEAST_STEP_S:
                proof.not_run.append(name)
                continue
            result = proof.work / f"{bench}-{size_px}.json"
            command = ["-m", "benchmarks", "gpu", "--only", bench, "--size", str(size_px)]
            command += ["--repeats", str(repeats), "--json", str(result)]
            status, said = run(proof.env, command, proof.left_s())
            if result.exists():
                found = json.loads(result.read_text(encoding="utf-8"))
                rows += found["rows"]
                done = {row["name"] for row in found["rows"]}
                left = [one for one in found["names"] if one not in done]
                name += f": {', '.join(left)}" if left else ""
            if status is None:
                proof.not_run.append(name)
            elif status:
                proof.failed.append(f"{name}: {how_it_ended(status, said)}")
            proof.keep()
            _tell(f"{bench} at {size_px} px done")


def _edge_px(text: str) -> int:
    if not text.isdecimal() or not LEAST_EDGE_PX <= int(text) <= MOST_EDGE_PX:
        raise argparse.ArgumentTypeError(
            f"must be a whole number from {LEAST_EDGE_PX} to {MOST_EDGE_PX} (got {text})"
        )
    return int(text)


def _first(text: str) -> str:
    return next((line.strip() for line in text.splitlines() if line.strip()), "")


def _tell(words: str) -> None:
    print(words, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
