"""Lines of browsers, edited in every way that comes to mind, with an honest participant beside.

Results come home as texts and as archives. Whatever a participant sends, the other one's session is
the same, byte for byte, and the command ends by itself: with a table, or with one message.
"""

import io
import json
import lzma
import re
import struct
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

from attack import mutations
from attack.campaign import Result, run_inputs
from attack.mutations import Shape
from attack.readers import Reader
from task_cases import case_text
from typer.testing import CliRunner
from web_kernel import running_kernel
from web_study import WEB_CASES, BuiltWebStudy, for_browsers, with_pixels

from protocols.errors import StudyError
from protocols.load import load_study
from study_app.cli import app
from study_app.web.export import WebBuild

TASKS = ("yes-no with confidence", "two-interval", "rating", "abx", "which-half")
HONEST, HOSTILE = "honest-1", "hostile-1"
LARGE = (10**9, 2**53 - 1, 1e9, 1e15, -1e9, 3.15e7, 86_400)
TEXTS = (
    "0000-00-00T00:00:00Z", "1960-01-01T00:00:00Z", "9999-12-31T23:59:59.999Z", HONEST, "xx", "de",
    "completed", "quit", "error", "void", "paused", "focus-lost", "resume", "start", "end", "note",
    "\x1b[2J\x1b]0;x\x07", "a\nerror: b", "\u202e", "0" * 64, "main-0001", "practice-0001", "link",
)  # fmt: skip


def _edited(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Change one field of one line into what might pass: a neighbour, another's, too much."""
    lines = data.split(b"\n")
    place = rng.randrange(len(lines) - 1)
    line = json.loads(lines[place])
    owner, key = rng.choice(list(mutations._places(line)))
    was = owner[key]
    other = json.loads(rng.choice(lines[:-1]))
    if isinstance(was, bool | None | str):
        owner[key] = rng.choice((*TEXTS, True, False, None, other.get(key)))
    elif isinstance(was, int | float):
        near = (was + 1, was - 1, was * 10, -was, was + rng.choice(LARGE), rng.choice(LARGE))
        owner[key] = rng.choice((*near, other.get(key), float(was), str(was)))
    else:
        owner[key] = rng.choice((other.get(key), was * 2 if isinstance(was, list) else [], None))
    lines[place] = json.dumps(line, separators=(",", ":")).encode()
    return b"\n".join(lines)


def _renumbered(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Leave lines out, put some in, or change their order, and number them anew."""
    lines = [json.loads(line) for line in data.split(b"\n") if line.strip()]
    one, two = sorted((rng.randrange(len(lines)), rng.randrange(len(lines))))
    match rng.randrange(4):
        case 0:
            del lines[one:two]
        case 1:
            lines[two:two] = [dict(line) for line in lines[one:two]]
        case 2:
            lines[one], lines[two] = lines[two], lines[one]
        case _:
            lines.append(dict(lines[one]))
    return b"".join(
        json.dumps(line | {"n": n}, separators=(",", ":")).encode() + b"\n"
        for n, line in enumerate(lines)
    )


def _encoded(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Write the text otherwise, or join it to itself in the middle of a line."""
    text = data.decode("utf-8", "replace")
    code = rng.choice(("utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252", "utf-32"))
    end = rng.choice(("\n", "\r\n", "\r", "", "\n\n", "\0"))
    cut = rng.randrange(len(data))
    return text.replace("\n", end).encode(code, "replace")[cut * rng.randrange(2) :] + data[:cut]


def _flooded(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Repeat a part of a line, or something in it, until it is large."""
    lines = data.split(b"\n")
    place, count = rng.randrange(len(lines) - 1), rng.choice((10_000, 300_000, 3_000_000))
    line = lines[place]
    match rng.randrange(5):
        case 0:
            line = line.replace(b'"flips_us":[', b'"flips_us":[' + b"1," * count)
        case 1:
            key = b'{"flip":0,"key":"z","at_us":0,"x":null},'
            line = line.replace(b'"presses":[', b'"presses":[' + key * (count // 30))
        case 2:
            line = re.sub(rb'(?<=":")[^"]+', b"a" * count, line, count=1)
        case 3:
            line = line[:-1] + b"".join(b',"k%d":1' % n for n in range(count // 10)) + b"}"
        case _:
            line = rng.choice((b'{"study":', b"[", b'{"a":', b"9", b"\n")) * count
    lines[place] = line
    return b"\n".join(lines)


LINES = Shape(
    (_edited, _edited, _edited, _edited, _renumbered, _encoded, _flooded, mutations._of_one_line,
     mutations._of_one_line, mutations._lines)
)  # fmt: skip


def _unpacked(data: bytes) -> bytes:
    try:
        return mutations._unzipped(data)
    except (lzma.LZMAError, RuntimeError):
        raise ValueError("harmed before") from None


def _packed(_: bytes, inner: bytes) -> bytes:
    """Pack a harmed text in one of many ways, which follows from its length."""
    rng = Random(len(inner))
    made = io.BytesIO()
    methods = (zipfile.ZIP_DEFLATED,) * 4 + (0, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    names = ("study_result_1/comp-result_1/data.txt", "a.TXT", "../a.txt", "\x1b[2J.txt", "b.zip")
    with zipfile.ZipFile(made, "w", rng.choice(methods)) as archive:
        archive.writestr(rng.choice((*names[:1] * 5, *names)), inner)
        if not rng.randrange(4):  # what grows without end
            archive.writestr("comp-result_2/data.txt", bytes(1 << rng.randrange(20, 28)))
    packed = made.getvalue()
    match rng.randrange(6):
        case 0:  # damaged in its middle
            place = rng.randrange(len(packed))
            packed = packed[:place] + rng.randbytes(8) + packed[place + 8 :]
        case 1:  # another length than it says
            packed = packed.replace(struct.pack("<I", len(inner)), struct.pack("<I", 100))
        case 2:  # encrypted
            marks = re.compile(rb"(PK\x03\x04..|PK\x01\x02....)..", re.DOTALL)
            packed = marks.sub(lambda found: found[1] + b"\1\0", packed)
    return packed


ARCHIVES = Shape(LINES.changes, _unpacked, _packed)


class Lab:
    """A study with its export, and results of two participants."""

    def __init__(self, name: str, folder: Path, kernel: Any) -> None:
        self.folder, self.name = folder, name.replace(" ", "-")
        folder.mkdir()
        text = case_text(WEB_CASES[name]) + '\n[web]\ngaze = "none"\ntolerance_s = 0.01\n'
        (folder / "study.toml").write_text(text, encoding="utf-8")
        study, display = load_study(folder / "study.toml")
        study = for_browsers(study, tolerance_s=0.01)
        manifest = with_pixels(study, folder / "stimuli")
        WebBuild(study, display, manifest).write(folder / "stimuli", folder / "out")
        of = BuiltWebStudy(study, display, manifest, folder / "stimuli", folder / "out")
        faults = {"missed": 0.02, "paused": 0.002, "disturbed": 0.002}
        self.honest = "".join(of.session(kernel, HONEST, slot=0, luck=3, **faults)["results"])
        sent = of.session(kernel, HOSTILE, slot=1, luck=4, killed=0.01, **faults)["results"]
        self.hostile = "".join(sent).encode()
        (folder / "honest.txt").write_text(self.honest, encoding="utf-8")
        self.alone = self.brought_home("alone", folder / "honest.txt")

    def brought_home(self, where: str, *results: Path) -> dict[str, bytes]:
        """Import by the command; return the files of the honest session.

        Raises
        ------
        StudyError
            If the command refuses: with its words.
        """
        words = [
            "session", "import-web", *results, "--protocol", self.folder / "study.toml",
            "--stimuli", self.folder / "stimuli", "--sessions", self.folder / where,
        ]  # fmt: skip
        done = CliRunner().invoke(app, list(map(str, words)))
        if done.exit_code not in (0, 2):
            raise RuntimeError(f"status {done.exit_code}") from done.exception
        assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f]", done.output), "hostile letters shown"
        self.said = done.output
        root = self.folder / where / "short" / HONEST
        found = {
            path.relative_to(root).as_posix(): path.read_bytes()
            for path in root.rglob("*")
            if path.is_file()
        }
        if where != "alone":
            assert found == self.alone, f"the honest session is another: {done.output[:500]}"
        if done.exit_code:
            raise StudyError(done.stderr)
        return found

    def meets(self, path: Path) -> list[str]:
        """Import what was harmed, with the honest participant beside it."""
        where = path.with_suffix(".sessions")
        return sorted(self.brought_home(str(where), path, self.folder / "honest.txt"))

    def readers(self, samples: Path) -> list[Reader]:
        """Write results to harm; return who reads them: as a text, and as an archive."""
        text, archive = samples / f"{self.name}.txt", samples / f"{self.name}.zip"
        text.write_bytes(self.hostile)
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as made:
            made.writestr("study_result_1/comp-result_1/data.txt", self.hostile)
        return [
            Reader(f"lines-{kind}-{self.name}", path.name, shape, self.meets)
            for kind, path, shape in (("text", text, LINES), ("archive", archive, ARCHIVES))
        ]


def attack_lines(
    count: int,
    seed: int,
    folder: Path,
    *,
    tasks: Sequence[str] = TASKS,
    keep: Path | None = None,
    until_s: float = float("inf"),
    on_input: Callable[[str, int], None] = lambda _reader, _count: None,
) -> list[Result]:
    """Bring home `count` harmed results, spread over tasks and forms; return what came of them."""
    readers: list[Reader] = []
    with running_kernel(folder) as kernel:
        labs = [Lab(name, folder / str(n), kernel) for n, name in enumerate(tasks)]

    def write(samples: Path) -> None:
        readers.extend(reader for lab in labs for reader in lab.readers(samples))

    return run_inputs(
        seed, count, readers=readers, write=write, keep=keep, until_s=until_s, on_input=on_input
    )
