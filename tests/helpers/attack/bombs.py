"""Bombs: small files that claim, or unpack to, more than a machine has; each for a command.

A command runs in a process of its own whose memory and time are watched. It must refuse the file in
one message, or do its work, within `MOST_MIB` and `MOST_CPU_S`.
"""

import gzip
import io
import json
import os
import resource
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random

import numpy as np
import psutil
from attack.readers import write_ods, write_xlsx
from PIL import Image

from pipeline.pictures.write import write_pixels
from protocols.load import shipped

MOST_MIB, MOST_CPU_S, MOST_WALL_S = 1024, 20.0, 180.0
"""Most that a command may take."""
_FENCE_BYTES = 8 << 30
"""Memory at which the system ends a process that nobody ends sooner."""
_CHUNK = bytes(1 << 24)
COMMAND = "from study_app.cli import main; main()"
READ = """
import sys, typer
from pathlib import Path
from {module} import {reader}
from study_app.cli.error_messages import user_errors
try:
    with user_errors():
        {reader}(Path(sys.argv[1]))
except typer.Exit as end:
    sys.exit(end.exit_code)
"""
Write = Callable[[Path], object]


@dataclass(frozen=True)
class Bomb:
    """A file and who reads it; ``{}`` stands for the folder it lies in."""

    name: str
    write: Write
    words: str
    code: str = COMMAND
    """Code to run, where no command without a screen reads such a file."""


@dataclass(frozen=True)
class Met:
    """Result of a command that met a bomb."""

    name: str
    status: int
    peak_mib: int
    cpu_s: float
    said: str

    @property
    def wrong(self) -> str | None:
        """Fault of the command; None where it held."""
        if "Traceback" in self.said or self.status not in (0, 2):
            return f"status {self.status}: {self.said[-200:]}"
        if self.status == 2 and not self.said.strip():
            return "refused without a word"
        if self.peak_mib > MOST_MIB:
            return f"{self.peak_mib} MiB"
        return f"{self.cpu_s:.0f} s" if self.cpu_s > MOST_CPU_S else None


def run_bombs(
    count: int, seed: int, until_s: float = float("inf"), tell: Callable[[], None] = lambda: None
) -> list[Met]:
    """Meet `count` of the bombs, others for each seed, or as many as fit until `until_s`."""
    met: list[Met] = []
    with tempfile.TemporaryDirectory() as made:
        for number, bomb in enumerate(Random(seed).sample(BOMBS, min(count, len(BOMBS)))):
            if time.monotonic() > until_s:
                break
            met.append(meet(bomb, Path(made) / str(number)))
            tell()
    return met


def meet(bomb: Bomb, folder: Path) -> Met:
    """Write a bomb into an empty folder, run its command, and return what came of it."""
    folder.mkdir(parents=True)
    bomb.write(folder)
    words = [word.format(folder) for word in bomb.words.split()]
    with (folder / "said").open("wb") as told:
        process = subprocess.Popen(
            [sys.executable, "-c", bomb.code, *words], cwd=folder, preexec_fn=_fence,
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=told,
            start_new_session=True, env=_usual_environment(),
        )  # fmt: skip
    peak, cpu_s, began_s = 0, 0.0, time.monotonic()
    watched = psutil.Process(process.pid)
    while process.poll() is None:
        with suppress(psutil.Error, OSError):
            peak = max(peak, sum(map(_held_mib, [watched, *watched.children(recursive=True)])))
            used = watched.cpu_times()
            cpu_s = max(cpu_s, sum(used[:4]))
        over = peak > 2 * MOST_MIB or cpu_s > 2 * MOST_CPU_S
        if over or time.monotonic() - began_s > MOST_WALL_S:
            os.killpg(process.pid, 9)
        time.sleep(0.02)
    said = (folder / "said").read_text("utf-8", "replace")
    shutil.rmtree(folder)
    return Met(bomb.name, process.returncode, peak, cpu_s, said)


def _usual_environment() -> dict[str, str]:
    """Environment that a user's shell gives a command, without what tests have set."""
    kept = ("PATH", "HOME", "LANG", "TMPDIR", "PYTHONPATH", "VIRTUAL_ENV")
    return {name: os.environ[name] for name in kept if name in os.environ}


def _fence() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (_FENCE_BYTES, _FENCE_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _held_mib(process: psutil.Process) -> int:
    status = Path(f"/proc/{process.pid}/status").read_text()
    line = next((row for row in status.splitlines() if row.startswith("VmHWM")), "VmHWM: 0")
    return int(line.split()[1]) >> 10


# --- what bombs are made of ----------------------------------------------------------------------


def text(name: str, *parts: str | tuple[str, int]) -> Write:
    """A file of texts, some of them many times."""

    def write(folder: Path) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w") as file:
            for part in parts:
                piece, times = part if isinstance(part, tuple) else (part, 1)
                step = max(1, (1 << 20) // max(len(piece), 1))
                for done in range(0, times, step):
                    file.write(piece * min(step, times - done))

    return write


def repeated(name: str, piece: bytes, times: int) -> Write:
    """A file of some bytes, many times."""
    return lambda folder: (folder / name).write_bytes(piece * times)


def sparse(name: str, size: int, head: bytes = b"") -> Write:
    """A file that takes no place on the disk: its beginning, then zeros."""

    def write(folder: Path) -> None:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            file.write(head)
            file.truncate(size)

    return write


def both(*writers: Write) -> Write:
    """Several files."""

    def write(folder: Path) -> None:
        for writer in writers:
            writer(folder)

    return write


def png(
    name: str, width: int, height: int, bits: int = 8, kind: int = 2, packed_text: int = 0
) -> Write:
    """A PNG of one colour, as small as it gets. `kind`: 0 grey, 2 colour, 6 with alpha.

    It has a text that unpacks to so many bytes.
    """

    def chunk(tag: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + tag + data + struct.pack(">I", zlib.crc32(tag + data))

    def write(folder: Path) -> None:
        row = b"\0" * (1 + {0: 1, 2: 3, 6: 4}[kind] * bits // 8 * width)
        packer = zlib.compressobj(9)
        many = row * max(1, (1 << 22) // len(row))
        rows = len(many) // len(row)
        parts = (many[: len(row) * min(rows, height - done)] for done in range(0, height, rows))
        packed = b"".join([*map(packer.compress, parts)]) + packer.flush()
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(
            b"\x89PNG\r\n\x1a\n"
            + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0))
            + (chunk(b"zTXt", b"note\0\0" + zlib.compress(bytes(packed_text), 1)) if packed_text
               else b"")
            + chunk(b"IDAT", packed)
            + chunk(b"IEND", b"")
        )  # fmt: skip

    return write


def saved(name: str, edge: int, **options: object) -> Write:
    """A picture of one colour in a format of Pillow's."""
    return lambda folder: Image.new("RGB", (edge, edge), (90, 120, 60)).save(
        folder / name, **options
    )


def exr(name: str, edge: int, channels: str) -> Write:
    """An OpenEXR file of one colour."""

    def write(folder: Path) -> None:
        names = channels.split()
        data = np.full((edge, edge, len(names)), 0.25, np.float32)
        write_pixels(folder / name, data, names, attributes={"compression": "zip"})

    return write


def frames(count: int, edge: int) -> Write:
    """A folder of pictures of one colour."""

    def write(folder: Path) -> None:
        png("frames/000000.png", edge, edge)(folder)
        for number in range(1, count):
            os.link(folder / "frames/000000.png", folder / f"frames/{number:06d}.png")

    return write


def zipped(name: str, **members: tuple[bytes, bytes, int, bytes]) -> Write:
    """A zip file: of each member the beginning, a piece, how often, and the end."""

    def write(folder: Path) -> None:
        with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
            for member, (head, piece, times, tail) in members.items():
                with packed.open(member.replace("__", "/"), "w", force_zip64=True) as file:
                    file.write(head)
                    block = piece * max(1, (1 << 20) // len(piece))
                    each = len(block) // len(piece)
                    for done in range(0, times, each):
                        file.write(block[: len(piece) * min(each, times - done)])
                    file.write(tail)

    return write


_MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'


def xlsx(
    sheet: tuple[str, str, int, str], strings: tuple[str, str, int, str] | None = None
) -> Write:
    """A workbook whose sheet has a beginning, a piece, how often, and an end."""

    def write(folder: Path) -> None:
        write_xlsx(folder / "whole.xlsx")
        own = {"xl/worksheets/sheet1.xml": sheet} | (
            {"xl/sharedStrings.xml": strings} if strings else {}
        )
        members = {}
        with zipfile.ZipFile(folder / "whole.xlsx") as packed:
            for name in packed.namelist():
                head, piece, times, tail = own.get(name, ("", "", 0, ""))
                whole = packed.read(name) if name not in own else b""
                members[name.replace("/", "__")] = (
                    whole or head.encode(), piece.encode() or b" ", times, tail.encode(),
                )  # fmt: skip
        zipped("t.xlsx", **members)(folder)
        (folder / "whole.xlsx").unlink()

    return write


_SHEET, _END = f"<worksheet {_MAIN}><sheetData>", "</sheetData></worksheet>"
_HEAD = '<row><c t="inlineStr"><is><t>participant</t></is></c></row>'


def many_members(name: str, count: int) -> Write:
    """A zip file with a long list of members that are all the same few bytes."""

    def write(folder: Path) -> None:
        head = struct.pack("<4s5H3I2H", b"PK\3\4", 20, 0, 0, 0, 0, 0, 0, 0, 8, 0) + b"a.txt123"
        with (folder / name).open("wb") as file:
            file.write(head)
            entry = struct.pack("<4s6H3I5H2I", b"PK\1\2", 20, 20, *[0] * 7, 8, *[0] * 6)
            file.writelines(entry + b"%08d" % number for number in range(count))
            size = file.tell() - len(head)
            file.write(struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, 0xFFFF, 0xFFFF, size, len(head), 0))

    return write


def gltf(**parts: object) -> Write:
    """A glTF file of one triangle, with some of its parts replaced."""
    floats = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    uri = "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3", "bufferView": 0}],
        "bufferViews": [{"buffer": 0, "byteLength": len(floats)}],
        "buffers": [{"byteLength": len(floats), "uri": uri}],
    }  # fmt: skip
    return lambda folder: (folder / "s.gltf").write_text(json.dumps(tree | parts))


def big_buffer(size: int) -> dict[str, object]:
    """Parts of a glTF file whose buffer is a sparse file beside it."""
    count = size // 12
    return {
        "accessors": [{"componentType": 5126, "count": count, "type": "VEC3", "bufferView": 0}],
        "bufferViews": [{"buffer": 0, "byteLength": size}],
        "buffers": [{"byteLength": size, "uri": "b.bin"}],
    }


def chain(count: int, folder: Path) -> None:
    """A glTF file of nodes of which each is the child of the one before."""
    nodes: list[dict[str, object]] = [{"children": [n + 1]} for n in range(count - 1)]
    gltf(nodes=[*nodes, {"mesh": 0}])(folder)


def study(*changes: tuple[str, str]) -> Write:
    """The shipped study `demo` with some lines changed."""

    def write(folder: Path) -> None:
        content = shipped("studies")["demo"].read_text("utf-8")
        for old, new in changes:
            assert old in content
            content = content.replace(old, new, 1)
        (folder / "study.toml").write_text(content, "utf-8")

    return write


def metamer(width: int, height: int) -> Write:
    """A compressed picture whose head is right and says any size."""

    def write(folder: Path) -> None:
        from pipeline.compression.codec import CompressionSettings, compress
        from pipeline.compression.compressed_file import to_bytes

        data = to_bytes(
            compress([np.full((64, 64, 3), 0.5, np.float32)], (32, 32), CompressionSettings())
        )
        body = bytearray(data[:-4])
        struct.pack_into("<II", body, data.index(struct.pack("<II", 64, 64)), width, height)
        (folder / "c.metamer").write_bytes(bytes(body) + struct.pack("<I", zlib.crc32(body)))

    return write


def packed_gaze(size: int) -> Write:
    """A recording that unpacks to any size."""

    def write(folder: Path) -> None:
        with gzip.open(folder / "g.csv.gz", "wb", 1) as file:
            file.write(b"t_s,x_px,y_px\n")
            for _ in range(size // len(_CHUNK)):
                file.write(_CHUNK)

    return write


def npz(count: int) -> Write:
    """A numpy file of zeros."""

    def write(folder: Path) -> None:
        head = io.BytesIO()
        np.lib.format.write_array_header_1_0(
            head, {"descr": "|u1", "fortran_order": False, "shape": (count, 10_000)}
        )
        zipped("d.npz", **{"arr_0.npy": (head.getvalue(), _CHUNK[: 1 << 20], 10_000 * count >> 20,
                                         bytes(10_000 * count % (1 << 20)))})(folder)  # fmt: skip

    return write


# --- the bombs ----------------------------------------------------------------------------------

_ANSWERS = "participant,signal,answer,correct,level,rating,first,second,chosen,rt_s\n"
_LINES = 9_900_000
_NEST = ("[", 100_000)


def _write_ods(folder: Path, row: str) -> None:
    write_ods(folder / "t.ods", row)


def _tables() -> Iterator[Bomb]:
    lines = text("t.csv", _ANSWERS, ("a\n", _LINES))
    yield Bomb("csv of 9.9e6 lines, imported", lines, "analysis import t.csv --out o")
    for command in ("detection", "ratings --by level", "psychometric --level level",
                    "reaction --by level"):  # fmt: skip
        name, *options = command.split()
        words = f"analysis {name} t.csv {' '.join(options)}"
        yield Bomb(f"csv of 9.9e6 lines, {name}", lines, words)
    most = text("t.csv", _ANSWERS, ("p,yes,no,0,1,2,a,b,a,0.5\n", 299_000))
    yield Bomb("csv of 3e6 cells", most, "analysis import t.csv --out o")
    yield Bomb("csv of one line of 1 GB", sparse("t.csv", 10**9), "analysis import t.csv --out o")
    wide = text("t.csv", ("c,", 30_000_000))
    yield Bomb("csv of 30e6 columns", wide, "analysis import t.csv --out o")
    quoted = text("t.csv", 'a,b\n"', ("x,\n", 20_000_000))
    yield Bomb("csv of one cell of 60 MB", quoted, "analysis import t.csv --out o")
    headers = {n: "".join(f"c{n}_{k}," for k in range(200)) for n in range(60)}
    rows = "," * 200 + "1\n", 200
    tables = both(*(text(f"d/{n}.csv", head, "z\n", rows) for n, head in headers.items()))
    yield Bomb("60 tables of 200 columns of their own", tables, "analysis import d --out o")
    cell = '<row><c r="XFD{}"><v>1</v></c></row>'.replace("{}", "1")
    far = xlsx((_SHEET, cell.replace(' r="XFD1"', ' r="XFD1"'), 1_000_000, _END))
    words = "analysis import t.xlsx --out o"
    yield Bomb("xlsx with a cell in column XFD of each row", far, words)
    yield Bomb("xlsx of 12e6 rows", xlsx((_SHEET + _HEAD, "<row/>", 12_000_000, _END)), words)
    yield Bomb("xlsx of 1.9 GB of blanks", xlsx((_SHEET, " ", 1_900_000_000, _END)), words)
    yield Bomb("xlsx of 200 MB of blanks", xlsx((_SHEET, " ", 200_000_000, _END)), words)
    deep = xlsx((_SHEET, "<a>", 3_000_000, _END))
    yield Bomb("xlsx of elements 3e6 deep", deep, words)
    shared = xlsx(
        (_SHEET, '<row><c t="s"><v>0</v></c></row>', 900_000, _END),
        (f"<sst {_MAIN}><si><t>", "x", 100_000_000, "</t></si></sst>"),
    )
    yield Bomb("xlsx of one text of 100 MB, 900,000 times", shared, words)
    texts = xlsx(
        (_SHEET, '<row><c t="s"><v>0</v></c></row>', 900_000, _END),
        (f"<sst {_MAIN}><si><t>", "x", 32_000, "</t></si></sst>"),
    )
    yield Bomb("xlsx of one text of 32 kB, 900,000 times", texts, words)
    laughs = xlsx((f'<!DOCTYPE a [<!ENTITY b "{"x" * 9999}">]>{_SHEET}', "<row/>", 1, _END))
    yield Bomb("xlsx of entities", laughs, words)
    yield Bomb("xlsx of 3e6 files", many_members("t.xlsx", 3_000_000), words)
    words = "analysis import t.ods --out o"
    text_cell = '<table:table-cell office:value-type="string"{}><text:p>{}</text:p>'
    text_cell += "</table:table-cell>"
    far = text_cell.format(' table:number-columns-repeated="16384"', "x" * 30_000)
    again = '</table:table-row><table:table-row table:number-rows-repeated="{}">'
    for name, row in (
        ("a text in each cell", again.format(1_048_575) + far),
        ("a text in each of 180 rows", again.format(180) + far),
        ("1e9 spaces", text_cell.format("", '<text:s text:c="1000000000"/>')),
    ):
        yield Bomb(f"ods of {name}", partial(_write_ods, row=row), words)
    yield Bomb("csv that is a zip of 3e6 files", many_members("t.csv", 3_000_000),
               "analysis import t.csv --out o")  # fmt: skip
    nested = both(text("decisions.csv", _ANSWERS), text("decisions.json", _NEST))
    yield Bomb("decisions.json of brackets", nested, "analysis report decisions.csv --out o")
    points = both(png("p.png", 64, 64), text("g.csv", "x_px,y_px\n", ("1,1\n", _LINES)))
    yield Bomb("gaze of 9.9e6 lines, to score", points,
               "stimuli score p.png p.png --gaze g.csv --out o")  # fmt: skip


def _recordings() -> Iterator[Bomb]:
    code = READ.format(module="study_app.gaze.recording", reader="load_recording")
    rows = text("g.csv", "t_s,x_px,y_px\n", ("0,1,1\n", _LINES))
    yield Bomb("recording of 9.9e6 lines", rows, "g.csv", code)
    some = text("g.csv", "t_s,x_px,y_px\n", ("0,1,1\n", 4_900_000))
    yield Bomb("recording of 4.9e6 lines", some, "g.csv", code)
    asc = text("g.asc", "START 1\n", ("1 2 3\n", 4_900_000))
    yield Bomb("asc of 4.9e6 lines", asc, "g.asc", code)
    blinks = text("g.asc", "START 1\n1 2 3\n", ("EBLINK L 1 2\n", 4_900_000))
    yield Bomb("asc of 4.9e6 blinks", blinks, "g.asc", code)
    parts = repeated("g.csv.gz", gzip.compress(b"", mtime=0), 800_000)
    yield Bomb("packed recording of 800,000 parts", parts, "g.csv.gz", code)
    yield Bomb("packed recording of 1.9 GB", packed_gaze(1_900_000_000), "g.csv.gz", code)
    yield Bomb("recording of one line of 1 GB", sparse("g.csv", 10**9), "g.csv", code)


def _studies() -> Iterator[Bomb]:
    words = "protocol check s.toml"
    key = text("s.toml", ("a.", 20_000), "a = 1\n")
    yield Bomb("toml key of 20,000 parts", key, words)
    header = text("s.toml", "[", ("a.", 20_000), "a]\n")
    yield Bomb("toml section of 20,000 parts", header, words)
    quoted = text("s.toml", "x = {", ('"a" . ', 20_000), "a = 1}\n")
    yield Bomb("toml inline key of 20,000 parts", quoted, words)
    yield Bomb("toml of brackets", text("s.toml", "x = ", _NEST), words)
    yield Bomb("toml of tables in tables", text("s.toml", "x = ", ("{a=", 100_000)), words)
    yield Bomb("toml of 1.9 GB", sparse("s.toml", 1_900_000_000), words)
    yield Bomb("toml of 2 MB of lists", text("s.toml", "x = [", ("[],", 600_000), "]"), words)
    for old, new in (
        ("participants = 4", "participants = 1_000_000_000_000"), ("turns = 1.0", "turns = 1e300"),
        ("max_attempts = 3", "max_attempts = 1_000_000_000"),
        ("hole_share = 0.02", "hole_share = 1e-12"), ("width_deg = 8.0", "width_deg = 1e-9"),
        ("repeats = 2", "repeats = 1_000_000_000"),
        ("duration_s = 1.0", "duration_s = 1e9"), ("fps = 30.0", "fps = 1e12"),
    ):  # fmt: skip
        yield Bomb(f"study with {new}", study((old, new)), "protocol show study.toml")
    nested = text("power.json", _NEST)
    yield Bomb(
        "power.json of brackets", nested, "protocol preregister demo --power {} --out p.html"
    )
    yield Bomb("manifest of brackets", text("c/manifest.json", _NEST), "stimuli check c")
    values = text("c/manifest.json", "[", ("[],", 30_000_000), "0]")
    yield Bomb("manifest of 30e6 lists", values, "stimuli check c")
    yield Bomb("manifest of 1.9 GB", sparse("c/manifest.json", 1_900_000_000), "stimuli check c")


def _records() -> Iterator[Bomb]:
    place = "s/demo/P1/journal.jsonl"
    for name, write in (
        ("1.5 GB", sparse(place, 1_500_000_000)), ("30e6 lines", text(place, ("{}\n", 30_000_000))),
        ("290,000 lines", text(place, ("{}\n", 290_000))), ("brackets", text(place, _NEST)),
        ("one line of 90 MB", text(place, '{"a":"', ("x", 90_000_000), '"}\n')),
        ("90 MB of lines", text(place, ('{"kind":"note","text":"' + "x" * 290 + '"}\n', 280_000))),
    ):  # fmt: skip
        yield Bomb(f"journal of {name}", write, "session verify s")
    yield Bomb("journal of 1.5 GB, to tables", sparse(place, 1_500_000_000),
               "analysis tidy s --protocol demo --out o")  # fmt: skip


def _pictures() -> Iterator[Bomb]:
    flat = png("p.png", 5773, 5773)
    for words in ("foveate p.png o.png", "foveate p.png o.png --numpy",
                  "compress p.png --out o.metamer", "denoise run p.png --gaze 1,1 --out o.png",
                  "texture bake p.png --out o.moments",
                  "stimuli score p.png p.png --out o", "warp p.png o.png --flow f.flo",
                  "warp p.png o.png --mask p.png",
                  "warp p.png o.png --depth p.png --parallax 0.1"):  # fmt: skip
        yield Bomb(f"png 5773 x 5773, {words}", flat, words)
    yield Bomb("png 4096 x 4096, compared", png("p.png", 4096, 4096),
               "foveate p.png o.png --compare c.png")  # fmt: skip
    yield Bomb("png 2048 x 2048, compressed", png("p.png", 2048, 2048),
               "compress p.png --out o.metamer")  # fmt: skip
    yield Bomb("png 3000 x 3000, scored", png("p.png", 3000, 3000),
               "stimuli score p.png p.png --out o")  # fmt: skip
    yield Bomb("png 60,000 x 60,000", png("p.png", 60_000, 300), "foveate p.png o.png --gaze 1,1")
    alpha = png("p.png", 4000, 4000, 16, 6)
    yield Bomb("png 4000 x 4000 of 16 bits and alpha", alpha, "foveate p.png o.png")
    noted = png("p.png", 64, 64, packed_text=500_000_000)
    yield Bomb("png with a text of 500 MB", noted, "foveate p.png o.png")
    depth = both(png("p.png", 64, 64), png("d.png", 9000, 9000, 16, 0))
    yield Bomb("depth 9000 x 9000", depth, "warp p.png o.png --depth d.png --parallax 0.1")
    for name, edge, options in (("p.jpg", 6000, {}), ("p.webp", 6000, {"lossless": True}),
                                ("p.tif", 6000, {"compression": "tiff_adobe_deflate"}),
                                ("p.gif", 6000, {})):  # fmt: skip
        yield Bomb(f"{name[2:]} {edge} x {edge}", saved(name, edge, **options),
                   f"compress {name} --out o.metamer")  # fmt: skip
    yield Bomb("jpg 6000 x 6000, foveated", saved("p.jpg", 6000), "foveate p.jpg o.png")
    yield Bomb("exr 4000 x 4000", exr("p.exr", 4000, "R G B"), "foveate p.exr o.png")
    yield Bomb("exr to warp", exr("w.exr", 3000, "R G B Z flow.x flow.y"), "warp w.exr o.png")
    yield Bomb("60 frames, compressed", frames(60, 1000), "compress frames --out o.metamer")
    yield Bomb("a frame 5773 x 5773, foveated", frames(2, 5773), "foveate frames o")
    yield Bomb(
        "a frame 5773 x 5773, denoised", frames(2, 5773), "denoise run frames --gaze 1,1 --out o"
    )
    yield Bomb("disparity of zeros", both(png("p.png", 64, 64), npz(90_000)),
               "warp p.png o.png --disparity d.npz")  # fmt: skip
    flow = sparse("f.flo", 10**9, struct.pack("<fii", 202021.25, 60_000, 60_000))
    yield Bomb("flow of 1 GB", both(png("p.png", 64, 64), flow), "warp p.png o.png --flow f.flo")
    yield Bomb("compressed picture 30,000 x 30,000", metamer(30_000, 30_000),
               "decompress c.metamer --out o.png")  # fmt: skip
    yield Bomb("compressed picture 8000 x 8000", metamer(8000, 8000),
               "decompress c.metamer --out o.png")  # fmt: skip


def _videos() -> Iterator[Bomb]:
    for kind, content in (
        ("ffconcat", "ffconcat version 1.0\nfile /dev/zero\n"),
        ("HLS", "#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\n/dev/zero\n#EXT-X-ENDLIST\n"),
        ("SDP", "v=0\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n"),
        ("DASH", "<?xml?><MPD></MPD>\n"),
    ):  # fmt: skip
        yield Bomb(f"video that is a list ({kind})", text("c.avi", content),
                   "compress c.avi --out o.metamer")  # fmt: skip
    yield Bomb("video that is a list, scored", text("c.mp4", "ffconcat version 1.0\nfile a.avi\n"),
               "stimuli score c.mp4 c.mp4 --out o")  # fmt: skip


def live_log(name: str, width: int, height: int) -> Write:
    """A log of a live picture of that size, as `metamerlab live --record` writes it."""

    def write(folder: Path) -> None:
        from pipeline.pictures.colour_file import PictureReading
        from protocols.load import load_display
        from study_app.live.log import LiveLog
        from study_app.live.renderer import RendererDescription

        log = LiveLog(
            folder / name, at="2026-01-01T00:00:00Z", source="builtin:garden",
            reading=vars(PictureReading()), gaze="mouse", renderer="", driver="", revision="",
            display=load_display("fhd27-60hz").model_dump(mode="json"), refresh_hz=60.0,
        )  # fmt: skip
        log.choice(
            RendererDescription(
                source_sha256="0" * 64, panorama=False, size_px=(width, height),
                centre_px=(0.0, 0.0), distance_px=1000.0, method="metamer", parameters={},
            )
        )  # fmt: skip
        log.close()

    return write


def _live() -> Iterator[Bomb]:
    for name, write, words in (
        ("png 5773 x 5773", png("p.png", 5773, 5773), "p.png"),
        ("png 60,000 x 60,000", png("p.png", 60_000, 300), "p.png"),
        ("panorama 11546 x 5773", png("p.png", 11_546, 5773), "p.png --panorama"),
        ("60 frames of 3000 x 3000", frames(60, 3000), "frames"),
    ):
        yield Bomb(f"{name}, live", write, f"live {words} --seconds 1")
    for name, write in (
        ("1.5 GB", sparse("l.jsonl", 1_500_000_000)), ("brackets", text("l.jsonl", _NEST)),
        ("290,000 lines", text("l.jsonl", ("{}\n", 290_000))),
        ("a picture 16,000 x 16,000", live_log("l.jsonl", 16_000, 16_000)),
        ("a picture 60,000 x 60,000", live_log("l.jsonl", 60_000, 60_000)),
    ):  # fmt: skip
        yield Bomb(f"live log of {name}", write, "live builtin:garden --verify l.jsonl")


def _meshes() -> Iterator[Bomb]:
    words = "stimuli look s.gltf --out o.png --views 1"
    none = [{"componentType": 5126, "count": 45_000_000, "type": "VEC3"}]
    yield Bomb("gltf accessor of 45e6 without a view", gltf(accessors=none), words)
    yield Bomb("gltf of 60,000 chained nodes", partial(chain, 60_000), words)
    yield Bomb("gltf of 9,000 chained nodes", partial(chain, 9_000), words)
    yield Bomb("gltf of 60,000 nodes", gltf(nodes=[{"mesh": 0}] * 60_000,
               scenes=[{"nodes": list(range(60_000))}]), words)  # fmt: skip
    shared = [{"primitives": [{"attributes": {"POSITION": 0}}] * 2000}]
    bin_ = sparse("b.bin", 12_000_000)
    own = big_buffer(12_000_000)
    some = [{"primitives": [{"attributes": {"POSITION": 0}}] * 30}]
    yield Bomb("gltf list used 30 times", both(bin_, gltf(meshes=some, **own)), words)
    yield Bomb("gltf list used 2,000 times", both(bin_, gltf(meshes=shared, **own)), words)
    views = big_buffer(12_000_000) | {
        "bufferViews": [{"buffer": 0, "byteLength": 12_000_000}] * 5000
    }
    yield Bomb("gltf views over one buffer, 5,000 times", both(bin_, gltf(**views)), words)
    nodes = [{"mesh": 0}] * 9000
    shown = gltf(nodes=nodes, scenes=[{"nodes": list(range(9000))}], **own)
    yield Bomb("gltf mesh shown 9,000 times", both(bin_, shown), words)
    circle = [{"children": [1]}, {"children": [0], "mesh": 0}]
    yield Bomb("gltf nodes in a circle", gltf(nodes=circle), words)
    yield Bomb("gltf of brackets", text("s.gltf", _NEST), words)
    yield Bomb("gltf of 1.9 GB", sparse("s.gltf", 1_900_000_000), words)
    textured = {
        "images": [{"uri": "t.png"}], "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    }  # fmt: skip
    yield Bomb("gltf with a texture 12,000 x 12,000",
               both(png("t.png", 12_000, 12_000), gltf(**textured)), words)  # fmt: skip
    many = textured | {"materials": textured["materials"] * 500}
    yield Bomb("gltf with a texture in 500 materials",
               both(png("t.png", 2000, 2000), gltf(**many)), words)  # fmt: skip


BOMBS = (
    *_tables(), *_recordings(), *_studies(), *_records(), *_pictures(), *_videos(), *_live(),
    *_meshes(),
)  # fmt: skip
"""Every bomb."""
QUICK = (
    "toml key of 20,000 parts", "video that is a list (ffconcat)",
    "gltf accessor of 45e6 without a view", "gltf mesh shown 9,000 times",
    "png 5773 x 5773, foveate p.png o.png",
)  # fmt: skip
"""Bombs that each run of the tests meets."""
