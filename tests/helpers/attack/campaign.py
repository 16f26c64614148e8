"""Feeds harmed files to readers, each in a process that may die, hang or grow, and notes what did.

Input `n` of a reader follows from the seed, the reader's name and `n`, and from nothing else.
"""

import math
import multiprocessing
import os
import resource
import shutil
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import psutil
import typer
from attack.mutations import mutated
from attack.readers import READERS, Reader, absurd, write_samples

from study_app.cli.error_messages import shortened_message, user_errors

HANG_CPU_S, HANG_WALL_S = 20.0, 120.0
"""Most that one input may take, of the processor and in all."""
GROWTH_MIB = 1024
"""Largest rise of the most memory that a process ever held through one input."""
MOST_MEMORY = 12 << 30
MESSAGE_MOST = 50_000
"""Characters that a message may have: one that repeats the file is none."""


class Failure(NamedTuple):
    """One input that no reader may meet like this."""

    reader: str
    number: int
    kind: str
    """`traceback`, `crash`, `hang`, `memory`, `absurd`, `message`."""
    said: str
    where: str
    """The innermost line of ours; empty where the process died."""


@dataclass
class Result:
    """Result of the inputs of one reader."""

    reader: str
    inputs: int = 0
    refused: int = 0
    """One message each."""
    failures: list[Failure] = field(default_factory=list)


def run_inputs(
    seed: int,
    total: int,
    *,
    readers: Sequence[Reader] = READERS,
    write: Callable[[Path], object] = write_samples,
    keep: Path | None = None,
    until_s: float = float("inf"),
    on_input: Callable[[str, int], None] = lambda _reader, _count: None,
) -> list[Result]:
    """Give every reader its part of `total` inputs, or as many as fit until `until_s`.

    Parameters
    ----------
    write : callable
        Fills a folder with the whole files of the readers.
    keep : Path, optional
        Where inputs that fail are written.
    until_s : float
        On the monotonic clock.
    on_input : callable
        Told the reader's name, and how many more inputs it has met.
    """
    results = []
    with tempfile.TemporaryDirectory() as made:
        samples = Path(made) / "samples"
        samples.mkdir()
        write(samples)
        parts = sum(reader.weight for reader in readers)
        for place, reader in enumerate(readers):
            share = math.ceil(total * reader.weight / parts)
            left_s = until_s - time.monotonic()
            end_s = time.monotonic() + left_s / (len(readers) - place)
            work = _Work(seed, reader, samples, Path(made) / "work")
            results.append(_one_reader(work, share, keep, end_s, on_input))
    return results


def harmed(seed: int, reader: Reader, number: int, samples: Path) -> bytes:
    """Return input `number` of a reader."""
    rng = Random(f"{seed} {reader.name} {number}")
    donors = [samples / other.file for other in READERS if other.shape is reader.shape]
    data = (samples / reader.file).read_bytes()
    return mutated(rng, data, reader.shape, [path.read_bytes() for path in donors])


@dataclass(frozen=True)
class _Work:
    seed: int
    reader: Reader
    samples: Path
    folder: Path


def _one_reader(
    work: _Work, share: int, keep: Path | None, until_s: float, on_input: Callable[[str, int], None]
) -> Result:
    result, number = Result(work.reader.name), 0
    fork = multiprocessing.get_context("fork")
    while number < share and time.monotonic() < until_s:
        ours, theirs = fork.Pipe()
        child = fork.Process(target=_meet, args=(theirs, work, number, share, until_s))
        child.start()
        theirs.close()
        ended = None
        while ended is None:
            told = _next_report(ours, child)
            if isinstance(told, str):  # it died or had to be killed
                ended, found = "again", Failure(work.reader.name, number, told, _fate(child), "")
            elif told is None:
                ended, found = "all", None
            else:
                found, refused = told
                result.refused += refused
            if ended != "all":
                result.inputs += 1
                on_input(work.reader.name, 1)
                if found is not None:
                    found = found._replace(number=number)
                    result.failures.append(found)
                    _keep(keep, work, number)
                number += 1
        child.join()
        ours.close()
        if ended == "all" and number < share:
            break  # the time is over
    return result


def _next_report(ours: Connection, child: Any) -> tuple[Failure | None, bool] | str | None:
    """Wait for what the child says of its next input; a word where it says nothing any more."""
    process = psutil.Process(child.pid)
    began_s, began_cpu_s = time.monotonic(), None
    while not ours.poll(0.5):
        try:
            spent_s = sum(process.cpu_times()[:2])
        except psutil.Error:
            break
        began_cpu_s = spent_s if began_cpu_s is None else began_cpu_s
        if spent_s - began_cpu_s > HANG_CPU_S or time.monotonic() - began_s > HANG_WALL_S:
            child.kill()
            child.join()
            return "hang"
        if not child.is_alive():
            break
    try:
        told: tuple[Failure | None, bool] | None = ours.recv()
        return told
    except EOFError:
        child.join()
        return "crash"


def _fate(child: Any) -> str:
    return f"exit status {child.exitcode}"


def _meet(pipe: Connection, work: _Work, first: int, last: int, until_s: float) -> None:
    """Read one harmed file after the other, and tell how each went: the child's whole life."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries in C have their own words
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("ignore")
    source = work.samples / work.reader.file
    for number in range(first, last):
        if time.monotonic() > until_s:
            break
        shutil.rmtree(work.folder, ignore_errors=True)
        depth = len(Path(work.reader.file).parts) - 1
        if depth:  # what lies beside it belongs to it
            top = Path(work.reader.file).parts[0]
            shutil.copytree(work.samples / top, work.folder / top)
        work.folder.mkdir(exist_ok=True)
        path = work.folder / work.reader.file
        path.write_bytes(harmed(work.seed, work.reader, number, work.samples))
        pipe.send(meet(work.reader, path))
    assert source.exists()
    pipe.send(None)


def meet(reader: Reader, path: Path) -> tuple[Failure | None, bool]:
    """Return the failure, if it is one, and whether the file was refused."""
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    def failure(kind: str, said: str, where: str = "") -> tuple[Failure, bool]:
        return Failure(reader.name, 0, kind, said[:300], where), False

    refused, value, told = False, None, []
    try:
        with _message(told):
            value = reader.read(path)
    except typer.Exit:
        refused = True
        if not told or not told[0].strip():
            return failure("message", "refused without a word")
        if len(told[0]) > MESSAGE_MOST:
            return failure("message", f"{len(told[0])} characters: {told[0][:200]}")
    except BaseException as error:
        return failure("traceback", f"{type(error).__name__}: {error}", _innermost(error))
    grown_mib = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib) // 1024
    if grown_mib > GROWTH_MIB:
        return failure("memory", f"{grown_mib} MiB more than ever before")
    wrong = None if refused else absurd(value, reader)
    return failure("absurd", wrong) if wrong else (None, refused)


class _message:  # noqa: N801
    """The command line's own way to one message, with the words kept."""

    def __init__(self, told: list[str]) -> None:
        self._told, self._errors = told, user_errors()

    def __enter__(self) -> None:
        self._errors.__enter__()

    def __exit__(self, kind: Any, error: Any, trace: Any) -> bool:
        if error is not None:
            self._told.append(shortened_message(str(error)))
        return bool(self._errors.__exit__(kind, error, trace))


def _innermost(error: BaseException) -> str:
    """Return the deepest frame that is not of a library."""
    root = str(Path(__file__).parents[3])
    ours = [
        f"{Path(frame.filename).relative_to(root)}:{frame.lineno}"
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename.startswith(root) and ".venv" not in frame.filename
    ]
    return ours[-1] if ours else ""


def _keep(keep: Path | None, work: _Work, number: int) -> None:
    if keep is None:
        return
    keep.mkdir(parents=True, exist_ok=True)
    name = f"{work.reader.name}-{work.seed}-{number}-{Path(work.reader.file).name}"
    (keep / name).write_bytes(harmed(work.seed, work.reader, number, work.samples))
