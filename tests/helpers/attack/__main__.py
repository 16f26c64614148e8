"""Attacks metamerlab from outside, by a seed: `script/attack`. Ends with 1 where anything fell."""

import argparse
import json
import platform
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

from attack.bombs import BOMBS, MOST_CPU_S, MOST_MIB, run_bombs
from attack.builds import build_by_command, kill_builds
from attack.campaign import Result, meet, run_inputs
from attack.guesses import guess_studies
from attack.home_lines import attack_lines
from attack.kills import CASES, kill_sessions
from attack.outputs import CASES as OUTPUTS
from attack.outputs import attack_outputs
from attack.planted import RATES_HZ, check_capture, check_timing
from attack.readers import READERS, Reader, write_samples
from built_study import write_small_study
from rich.console import Console
from rich.progress import Progress

from benchmarks.shared.output import PagePart
from protocols.revision import code_revision

PAGE_PART = PagePart("attack")
FAULTS_AT_ONCE = 20
Count = Callable[[], None]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what was asked for; return the exit status."""
    asked = _parser().parse_args(arguments)
    readers = [r for r in READERS if not asked.reader or r.name in asked.reader]
    if asked.again is not None:
        return _again(readers, asked.again)
    counts = {kind: getattr(asked, kind) for kind in _KINDS}
    if not any(counts.values()):
        counts = dict(_KINDS)
    print(f"seed {asked.seed}; what fails is written to {asked.keep}", file=sys.stderr)
    until_s = time.monotonic() + asked.seconds
    figures: dict[str, Any] = {}
    with Progress(console=Console(stderr=True)) as bars:
        tasks = {k: bars.add_task(k, total=count) for k, count in counts.items() if count}

        def counter(kind: str) -> Count:
            return lambda: bars.advance(tasks[kind])

        for kind, attack in _OTHERS.items():
            if counts[kind]:
                figures[kind] = attack(counts[kind], asked.seed, until_s, counter(kind))
        if counts["inputs"]:

            def on_input(name: str, count: int) -> None:
                bars.update(tasks["inputs"], description=name, advance=count)

            results = run_inputs(
                asked.seed, counts["inputs"], readers=readers, keep=asked.keep, until_s=until_s,
                on_input=on_input,
            )  # fmt: skip
            figures["inputs"] = _of_inputs(results)
    how = {
        "seed": asked.seed, "revision": code_revision(), "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
    }  # fmt: skip
    before = json.loads(asked.json.read_text()) if asked.json.exists() else {}
    figures = before | {kind: how | found for kind, found in figures.items()}
    asked.json.parent.mkdir(parents=True, exist_ok=True)
    asked.json.write_text(json.dumps(figures, indent=1, sort_keys=True) + "\n")
    print(table(figures))
    if asked.page:
        PAGE_PART.replace(asked.page, table(figures))
    return int(any(figures[kind]["failures"] for kind, count in counts.items() if count))


_KINDS = {
    "inputs": 20_000,
    "kills": 180,
    "full_disks": 90,
    "builds": 10,
    "faults": 3000,
    "captures": 3000,
    "guesses": 400,
    "bombs": len(BOMBS),
    "outputs": len(OUTPUTS),
    "lines": 2000,
}
"""Kinds of attack that run where none is asked for, and how many of each."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="script/attack", description=__doc__)
    for kind, (says, default) in _SAYS.items():
        parser.add_argument(
            f"--{kind.replace('_', '-')}", type=int, default=0, metavar="N",
            help=f"{says}; {default} where nothing is asked for",
        )  # fmt: skip
    parser.add_argument("--seed", type=int, default=time.time_ns() % 10**6)
    parser.add_argument(
        "--seconds", type=float, default=float("inf"), help="stop after this long, however far"
    )
    parser.add_argument(
        "--reader", action="append", choices=[reader.name for reader in READERS],
        help="of the inputs: this reader alone; may be given more than once",
    )  # fmt: skip
    parser.add_argument(
        "--again", type=Path, metavar="FILE",
        help="with --reader: read a file that was kept once more, in this process",
    )  # fmt: skip
    out = Path("out/attack")
    parser.add_argument("--keep", type=Path, default=out / "found", help="for inputs that fail")
    parser.add_argument(
        "--json",
        type=Path,
        default=out / "attack.json",
        help="for the figures; those of attacks that are not made now stay",
    )
    parser.add_argument("--page", type=PAGE_PART.page, help="a page whose table is renewed")
    return parser


_SAYS = {
    kind: (says, _KINDS[kind])
    for kind, says in {
        "inputs": "harmed files, spread over all readers",
        "kills": "kills of sessions, spread over all tasks",
        "full_disks": "disks that are full in the midst of a session",
        "builds": "kills of builds",
        "faults": "faults of timing that are planted",
        "captures": "captures of a screen with one thing amiss",
        "guesses": "guesses from public exports, who came when",
        "bombs": "small files that claim or unpack to much, each for a command",
        "outputs": "odd places to write to, spread over all commands that write",
        "lines": "edited lines and archives of browsers, spread over five tasks",
    }.items()
}


def _of_inputs(results: Sequence[Result]) -> dict[str, Any]:
    return {
        "done": sum(result.inputs for result in results),
        "refused": sum(result.refused for result in results),
        "failures": [failure._asdict() for result in results for failure in result.failures],
        "readers": {r.reader: {"inputs": r.inputs, "refused": r.refused} for r in results},
    }


def _sessions(full: bool) -> Callable[[int, int, float, Count], dict[str, Any]]:
    def attack(count: int, seed: int, until_s: float, on_kill: Count) -> dict[str, Any]:
        done, died, failures = 0, 0, []
        for place, name in enumerate(CASES):
            share = count // len(CASES) + (place < count % len(CASES))
            if not share or time.monotonic() > until_s:
                continue
            with tempfile.TemporaryDirectory() as folder:
                try:
                    found = kill_sessions(
                        name, Path(folder), share, seed=seed, full=full, on_kill=on_kill
                    )
                    done, died = done + found.kills, died + found.died
                except AssertionError as error:
                    failures.append(f"{name}: {error}"[:300])
        return {"done": done, "died": died, "failures": failures}

    return attack


def _builds(count: int, seed: int, _until_s: float, on_kill: Count) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        study = write_small_study(folder)
        built = build_by_command(study, folder / "whole")
        failures = [] if built.returncode == 0 else [built.stderr]
        try:
            kill_builds(
                study, folder / "whole", folder / "clips", count, seed=seed, on_kill=on_kill
            )
        except AssertionError as error:
            failures.append(str(error)[:300])
    return {"done": count, "failures": failures}


def _guesses(count: int, seed: int, until_s: float, on_guess: Count) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        done, failures = guess_studies(count, seed, Path(folder), until_s, on_guess)
    return {"done": done, "failures": failures}


def _faults(count: int, seed: int, until_s: float, on_fault: Count) -> dict[str, Any]:
    def one(number: int) -> None:
        rate_hz = RATES_HZ[number % len(RATES_HZ)]
        off_share = (0.0, 0.0005, -0.0005)[number % 3]
        check_timing(FAULTS_AT_ONCE, rate_hz, off_share, f"{seed} {number}")

    return _checks(one, count, FAULTS_AT_ONCE, until_s, on_fault)


def _captures(count: int, seed: int, until_s: float, on_capture: Count) -> dict[str, Any]:
    return _checks(lambda n: check_capture(f"{seed} {n}"), count, 1, until_s, on_capture)


def _outputs(count: int, seed: int, until_s: float, on_case: Count) -> dict[str, Any]:
    cases = Random(seed).sample(OUTPUTS, min(count, len(OUTPUTS)))
    done, failures = attack_outputs(cases, seed, until_s=until_s, on_case=on_case)
    return {"done": done, "commands": len({name for name, _ in cases}), "failures": failures}


def _lines(count: int, seed: int, until_s: float, on_input: Count) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        results = attack_lines(
            count, seed, Path(folder), until_s=until_s, on_input=lambda _name, _count: on_input()
        )
    return _of_inputs(results)


def _checks(
    check: Callable[[int], None], count: int, at_once: int, until_s: float, tell: Count
) -> dict[str, Any]:
    done, failures = 0, []
    while done < count and time.monotonic() < until_s:
        try:
            check(done)
        except AssertionError as error:
            failures.append(f"{done}: {error}"[:300])
        done += at_once
        for _ in range(at_once):
            tell()
    return {"done": done, "failures": failures}


def _bombs(count: int, seed: int, until_s: float, on_bomb: Count) -> dict[str, Any]:
    met = run_bombs(count, seed, until_s, on_bomb)
    return {
        "done": len(met),
        "refused": sum(one.status == 2 for one in met),
        "most_mib": max((one.peak_mib for one in met), default=0),
        "most_cpu_s": round(max((one.cpu_s for one in met), default=0.0), 1),
        "failures": [f"{one.name}: {one.wrong}" for one in met if one.wrong],
    }


_OTHERS = {
    "kills": _sessions(False),
    "full_disks": _sessions(True),
    "builds": _builds,
    "faults": _faults,
    "captures": _captures,
    "guesses": _guesses,
    "bombs": _bombs,
    "outputs": _outputs,
    "lines": _lines,
}


def table(figures: dict[str, Any]) -> str:
    """Return the figures as the page has them."""
    readers = figures.get("inputs", {}).get("readers", {})
    rows = [
        "| attack | how many | lost, missed or accepted | seed |",
        "| --- | ---: | ---: | ---: |",
    ]
    says = {
        "kills": "`kill -9` of a session, at any write or sync",
        "full_disks": "disk full in a session, at any write or sync",
        "builds": "`kill -9` of a build of clips",
        "faults": "late, missed and doubled flips that were planted",
        "captures": "captures of a screen with one thing amiss",
        "guesses": "guesses from public exports, who came when",
        "bombs": f"small files that claim or unpack to much, for commands ({MOST_MIB} MiB,"
        f" {MOST_CPU_S:.0f} s)",
        "outputs": "odd places to write to, for"
        f" {figures.get('outputs', {}).get('commands')} commands",
        "lines": "edited lines and archives of browsers: of the honest participant beside each",
        "inputs": f"harmed files, for {len(readers)} readers",
    }
    for kind, what in says.items():
        if kind in figures:
            found = figures[kind]
            failed = len(found["failures"])
            rows.append(f"| {what} | {found['done']:,} | {failed} | {found['seed']} |")
    if "inputs" in figures:
        kinds = Counter(failure["kind"] for failure in figures["inputs"]["failures"])
        refused = figures["inputs"]["refused"]
        rows += [
            "",
            f"Of the harmed files {refused:,} were refused with one message, and the others were"
            " still whole enough to be read.",
        ]
        if kinds:
            rows.append("Failed: " + ", ".join(f"{n} {kind}" for kind, n in kinds.items()) + ".")
    return "\n".join(rows)


def _again(readers: Sequence[Reader], kept: Path) -> int:
    """Read one harmed file in this process, so that what comes up is seen."""
    (reader,) = readers
    with tempfile.TemporaryDirectory() as folder:
        write_samples(Path(folder))
        path = Path(folder) / reader.file
        path.write_bytes(kept.read_bytes())
        failure, refused = meet(reader, path)
        print(failure or ("refused" if refused else "read, and nothing absurd in it"))
        if failure and failure.kind == "traceback":
            reader.read(path)
    return int(failure is not None)


if __name__ == "__main__":
    sys.exit(main())
