"""Gives every command that writes an odd place to write to, and looks at what a user had there.

Whatever the place, a command ends well or with one message; it never changes or removes a file that
it did not write, and where it refuses it leaves nothing behind.
"""

import ctypes
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from posixpath import normpath
from random import Random

import forked
import numpy as np
from attack.readers import SIZE, write_samples
from built_study import write_small_study
from PIL import Image

from pipeline.compression.codec import CompressionSettings, compress
from pipeline.compression.compressed_file import to_bytes
from protocols.disk.result_folder import LISTING
from protocols.load import load_display
from protocols.study_file.new_study import study_files
from stimuli.recipes.example_pictures import example_files

TIMEOUT_S = 240.0
MINE = (
    "thesis.txt", "results.json", "decisions.csv", "power.json", "000000.png", ".thesis.7.part",
    "figures/plot.png", "sessions/P01/journal.jsonl", "study.secret",
)  # fmt: skip
"""Files that a user may have in a folder, some of them called as results are."""


@dataclass(frozen=True)
class Command:
    """A command that writes."""

    name: str
    words: str
    """``{o}`` is the place, ``{i}`` the folder of what it reads."""
    reads: Sequence[str] = ()
    """Below that folder."""
    ending: str = ""
    """Of the file that it writes; empty: it fills a folder."""
    goes_on: bool = False
    """True if what it had finished when the disk was full stays for the next run."""


def _analysis(
    name: str, table: str, options: str = "", *, command: str = "", replace: str = "--replace"
) -> Command:
    words = f"analysis {command or name} {{i}}/{table} {options} --out {{o}} {replace}"
    return Command(name, words, [table])


COMMANDS = (
    _analysis("tidy", "demo", "--protocol demo"),
    _analysis("report", "decisions.csv", "--no-figures"),
    _analysis("import", "decisions.csv"),
    _analysis("reaction", "decisions.csv", "--by chosen"),
    _analysis("ratings", "rated.csv", "--by first"),
    _analysis("detection", "trials.csv", "--signal yes"),
    Command(
        "power",
        "analysis power --pairs 1 --scenes 2 --repeats 2 --participants 4 --rate 0.8 --studies 100"
        " --out {o} --replace",
    ),
    *(
        _analysis(form, "demo", f"--protocol demo --format {form}", command="export", replace="")
        for form in ("bids", "pwcmp")
    ),
    Command("new-study", "new-study {o} --name made"),
    Command("simulate", "session simulate demo --participants 1 --out {o}", goes_on=True),
    Command(
        "build", "stimuli build {i}/yes-no/study.toml --out {o} --workers 1", ["yes-no"],
        goes_on=True,
    ),
    Command(
        "score",
        "stimuli score {i}/p.png {i}/frames/000001.png --metrics psnr --workers 1 --out {o}",
        ["p.png"], goes_on=True,
    ),
    Command("foveate-frames", "foveate {i}/frames {o} --numpy --method blur", ["frames"]),
    Command("decompress-clip", "decompress {i}/clip.metamer --out {o} --numpy", ["clip.metamer"]),
    Command("foveate", "foveate {i}/p.png {o} --numpy --method blur", ["p.png"], ".png"),
    Command("compress", "compress {i}/p.png --out {o}", ["p.png"], ".metamer"),
    Command("decompress", "decompress {i}/c.metamer --out {o} --numpy", ["c.metamer"], ".png"),
    Command("bake", "texture bake {i}/p.png --out {o}", ["p.png"], ".moments"),
    Command("preview", "protocol preview {i}/study.toml --out {o}", ["study.toml"], ".html"),
    Command("preregister", "protocol preregister {i}/study.toml --out {o}", ["study.toml"], ".md"),
    Command("copy", "protocol copy demo {o}", ending=".toml"),
    _analysis("psychometric", "trials.csv", "--level level --guess 0.5"),
    Command("denoise-frames", "denoise run {i}/frames --gaze 9,5 --out {o} --numpy", ["frames"]),
    Command("denoise", "denoise run {i}/p.png --gaze 9,5 --out {o} --numpy", ["p.png"], ".png"),
    Command("warp", "warp {i}/w.exr {o}", ["w.exr"], ".png"),
    Command("look", "stimuli look {i}/s.glb --out {o} --views 2", ["s.glb"], ".png"),
    Command("panorama", "stimuli panorama {i}/s.glb --out {o} --height-px 16", ["s.glb"], ".png"),
    Command("show", "texture show planet --out {o} --size-px 64", [], ".png"),
    Command("holes", "stimuli export-holes {i}/small.toml --out {o}", ["small.toml"]),
)  # fmt: skip
PLACES = (
    "new", "exists", "mine", "link", "input", "file", "dot", "inside", "read-only", "full",
)  # fmt: skip
_LEFT_OVER = re.compile(r"(^|/)\.[^/]*\.(part|tmp\.[a-z]+|(unfinished|old)-[^/]*)($|/)")
CASES = [(command.name, place) for command in COMMANDS for place in PLACES]

_LIMITED = """
import io, resource, signal, sys
from study_app.cli import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
streams = sys.stdout, sys.stderr
sys.stdout, sys.stderr = io.StringIO(), io.StringIO()
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, resource.RLIM_INFINITY))
try:
    main()
finally:
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
    for stream, told in zip(streams, (sys.stdout, sys.stderr)):
        stream.write(told.getvalue())
"""
_UNPRIVILEGED = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
from attack.outputs import obey_permissions
from study_app.cli import main
obey_permissions()
main()
"""


def obey_permissions() -> None:
    """Have this process stopped by permissions, also where it is root's."""
    header = (ctypes.c_uint32 * 2)(0x20080522, 0)  # Linux's third version of capabilities
    sets = (ctypes.c_uint32 * 6)()
    libc = ctypes.CDLL(None, use_errno=True)
    libc.capget(header, sets)
    sets[0] &= ~0b110  # what reads and writes past permissions, of what is in effect
    if libc.capset(header, sets):
        raise OSError(ctypes.get_errno(), "capset")


def attack_outputs(
    cases: Sequence[tuple[str, str]],
    seed: int,
    *,
    until_s: float = float("inf"),
    on_case: Callable[[], None] = lambda: None,
) -> tuple[int, list[str]]:
    """Try cases of command and place; return how many, and what fell, a line each."""
    done, failures = 0, []
    with tempfile.TemporaryDirectory() as made:
        inputs = Path(made) / "inputs"
        inputs.mkdir()
        if {name for name, _ in cases} & {one.name for one in COMMANDS if "{i}" in one.words}:
            _write_inputs(inputs)
        before = snapshot(inputs)
        for name, place in cases:
            if time.monotonic() > until_s:
                break
            command = next(one for one in COMMANDS if one.name == name)
            folder = Path(made) / "case"
            folder.mkdir()
            wrong = _Case(command, place, folder, inputs, Random(f"{seed} {name} {place}")).run()
            if snapshot(inputs) != before:
                wrong = "what it reads was changed"
            if wrong:
                failures.append(f"{name}, {place}: {wrong}")
            shutil.rmtree(folder)
            done += 1
            on_case()
    return done, failures


def snapshot(folder: Path) -> dict[str, bytes | str | None]:
    """Return every file, link and folder below a folder, with what it holds."""
    found: dict[str, bytes | str | None] = {}
    for path in sorted(folder.rglob("*")):
        held = str(path.readlink()) if path.is_symlink() else None
        if path.is_file() and not path.is_symlink():
            held = path.read_bytes()
        found[path.relative_to(folder).as_posix()] = held
    return found


class _Case:
    def __init__(
        self, command: Command, place: str, folder: Path, inputs: Path, rng: Random
    ) -> None:
        self.command, self.place, self.folder, self.rng = command, place, folder, rng
        self.inputs, self.here, self.code = inputs, folder, forked.METAMERLAB
        self.out = str(folder / f"made{command.ending}")

    def run(self) -> str | None:
        """Return what is wrong, in words."""
        try:
            getattr(self, f"_at_{self.place.replace('-', '_')}")()
        except OSError as error:
            return str(error)
        before = snapshot(self.folder)
        done = self._call(self.code)
        after = snapshot(self.folder)
        said = done.stderr.strip().splitlines()
        if "Traceback" in done.stderr or done.returncode not in (0, 2):
            return f"status {done.returncode}: {said[-1] if said else ''}"
        if done.returncode and not said:
            return "refused without a word"
        if done.returncode == 0:
            left = [name for name in after.keys() - before.keys() if _LEFT_OVER.search(name)]
            lost = self._lost(before, after)
            return f"lost {lost}" if lost else f"left {left}" if left else None
        if self.place == "new":
            return f"refused: {said[-1]}"
        if self.place == "full":
            return self._went_on(before, after)
        different = {n for n in before.keys() | after.keys() if before.get(n) != after.get(n)}
        return f"refused, and changed {sorted(different)}" if different else None

    def _lost(self, before: dict[str, object], after: dict[str, object]) -> list[str]:
        """Return a user's files that are not as they were, but for what was to be written."""
        own = Path(normpath(self.here / self.out)).relative_to(self.folder).as_posix()
        replaced = self.place in ("exists", "inside") or self.command.ending
        return [
            name
            for name, held in before.items()
            if after.get(name, "gone") != held
            and not (replaced and (name == own or name.startswith(f"{own}/")))
        ]

    def _went_on(self, before: dict[str, object], after: dict[str, object]) -> str | None:
        """Return what is wrong after a full disk, once there is room again."""
        if not self.command.goes_on and after != before:
            return f"left {sorted(after.keys() - before.keys())}"
        again = self._call(forked.METAMERLAB)
        if again.returncode:
            return f"did not go on: {again.stderr[-300:]}"
        left = [name for name in snapshot(self.folder) if name.endswith(".part")]
        return f"left {left}" if left else None

    def _call(self, code: str):
        words = [word.format(o=self.out, i=self.inputs) for word in self.command.words.split()]
        return forked.run(*words, code=code, folder=self.here, timeout=TIMEOUT_S)

    def _write_once(self) -> None:
        """Write as a user would before, at a new place."""
        done = self._call(forked.METAMERLAB)
        if done.returncode:
            raise OSError(f"refused a new place: {done.stderr[-300:]}")

    # --- the places -----------------------------------------------------------------------------

    def _at_new(self) -> None:
        pass

    def _at_exists(self) -> None:
        """Folder that the same command wrote before."""
        self._write_once()

    def _at_mine(self) -> None:
        mine = self._mine()
        self.out = str(mine / f"../mine/made{self.command.ending}" if self.command.ending else mine)

    def _mine(self) -> Path:
        """Write a user's folder, with files called as those that the command writes."""
        mine = self.folder / "mine"
        _fill(mine, MINE)
        if not self.command.ending:
            self._write_once()
            made = Path(self.out)
            names = [path.relative_to(made) for path in made.rglob("*") if path.is_file()]
            _fill(mine, [str(name) for name in names if name.name != LISTING])
            shutil.rmtree(made)
        return mine

    def _at_link(self) -> None:
        self._mine()
        link = Path(self.out)
        link.symlink_to("mine/thesis.txt" if self.command.ending else "mine")

    def _at_input(self) -> None:
        """Folder of what it reads; a file: one of these."""
        mine = self.folder / "mine"
        mine.mkdir()
        for name in self.command.reads:
            copy = shutil.copytree if (self.inputs / name).is_dir() else shutil.copy
            copy(self.inputs / name, mine / name)
        for name in ("frames", "few"):  # which go with these
            if not (mine / name).exists() and f"{{i}}/{name}" in self.command.words:
                shutil.copytree(self.inputs / name, mine / name)
        self.inputs = mine
        self.out = str(mine / (*self.command.reads, "none")[0] if self.command.ending else mine)

    def _at_file(self) -> None:
        """A file where a folder should be."""
        (self.folder / "thesis.txt").write_text("precious")
        self.out = str(self.folder / "thesis.txt")
        if self.command.ending:
            self.out += f"/made{self.command.ending}"

    def _at_dot(self) -> None:
        self.here, self.out = self._mine(), "."

    def _at_inside(self) -> None:
        """From within what the same command wrote before; a file: within a folder of its name."""
        if self.command.ending:
            self.here = Path(self.out)
            _fill(self.here, MINE)
        else:
            self._write_once()
            self.here = Path(self.out)
        self.out = f"../{self.here.name}"

    def _at_read_only(self) -> None:
        mine = self.folder / "mine"
        _fill(mine, MINE)
        mine.chmod(0o555)
        self.code, self.out = _UNPRIVILEGED, str(mine / Path(self.out).name)

    def _at_full(self) -> None:
        """A disk that takes no file beyond some size, smaller than the largest that is written."""
        self._write_once()
        out = Path(self.out)
        largest = max(path.stat().st_size for path in (out, *out.rglob("*")) if path.is_file())
        self.code = _LIMITED.format(limit=self.rng.randrange(largest))
        shutil.rmtree(out) if out.is_dir() else out.unlink()


def _fill(folder: Path, names: Sequence[str]) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("precious\n")


def _write_inputs(folder: Path) -> None:
    """Write what the commands read."""
    write_samples(folder)
    rng = np.random.default_rng(5)
    (folder / "frames").mkdir()
    pictures = rng.integers(0, 256, (2, SIZE[1], SIZE[0], 3), dtype=np.uint8)
    for number, picture in enumerate(pictures):
        Image.fromarray(picture).save(folder / "frames" / f"{number:06d}.png")
    clip = compress(list(pictures / np.float32(255)), (9.0, 5.0), CompressionSettings(angles=32))
    (folder / "clip.metamer").write_bytes(to_bytes(clip))
    write_small_study(folder)
    (folder / "rated.csv").write_text(
        "participant,first,rating\n"
        + "".join(f"P{n % 4},{'ab'[n % 2]},{1 + n * n % 11 % 5}\n" for n in range(40))
    )
    display = load_display("fhd27-60hz").model_copy(update={"name": "my-display"})
    texts = study_files("made", "Made", display, "yes-no")
    files = {name: text.encode() for name, text in texts.items()} | example_files("yes-no")
    for name, data in files.items():
        (folder / "yes-no" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "yes-no" / name).write_bytes(data)
