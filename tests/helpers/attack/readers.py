"""Every reader of files that come from outside: a whole file to harm, the reader, and what no value
that it returns may be. One entry of `READERS` each.
"""

import dataclasses
import gzip
import math
import shutil
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import trimesh
from attack import mutations
from attack.mutations import Shape
from denoising_networks import to_onnx
from number_files import load_plane, write_flo
from PIL import Image
from pydantic import BaseModel

from analysis.export.bids_gaze import read_samples
from analysis.tables.decisions import read_decisions
from analysis.tables.spreadsheet import read_spreadsheet
from analysis.tables.trials import read_trials
from analysis.tidy import read_sessions
from pipeline.compression.codec import CompressionSettings as CompressedAs
from pipeline.compression.codec import compress, decompress
from pipeline.compression.compressed_file import read_compressed, to_bytes
from pipeline.denoising.network import DenoisingNetwork, NetworkFacts
from pipeline.methods.onnx import OnnxNetwork
from pipeline.pictures.colour_file import PictureReading, load_colour, read_any
from pipeline.pictures.decode import read_parts
from pipeline.pictures.depth_and_flow import load_depth, read_flow
from pipeline.pictures.panorama_file import load_panorama
from pipeline.pictures.stored_frames import read_frames, read_picture
from pipeline.pictures.warp_input import load_warp_input, read_pose
from pipeline.pictures.write import write_pixels
from pipeline.textures.bake import Layout, strips
from pipeline.textures.baked_file import read_baked, write_baked
from protocols.disk.hashing import sha256_bytes
from protocols.display import Display
from protocols.feasibility import virtual_manifest
from protocols.journal import SideFile
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol, load_toml, shipped
from protocols.manifest import read_manifest, write_manifest
from protocols.recipes.files import read_table as read_stimuli
from stimuli.media.png import decode_png
from stimuli.scenes.mesh_file import load_world
from stimuli.score.viewing_conditions import open_viewing, read_viewer_gaze
from study_app.attempt import FLIPS_HEADER, LIVE_HEADER
from study_app.gaze.recording import load_recording
from study_app.gaze.simulated import STEADY
from study_app.live.log import LiveLog, read_log
from study_app.live.loop import DrawnFlip, Latency
from study_app.live.redraw import gaze_by_stamp, read_flips
from study_app.live.renderer import GazeState, LiveView, RendererDescription
from study_app.session_folders import SessionFolder
from study_app.simulate import SimulatedStudy, simulate_study
from study_app.verification import verify

SIZE = (20, 14)
"""Of pictures: width and height."""


@dataclass(frozen=True)
class Reader:
    """One reader of files from outside."""

    name: str
    file: str
    """Whole, below the folder of samples; its folder comes along."""
    shape: Shape
    read: Callable[[Path], Any]
    may_be: Callable[[str, float], bool] = lambda _place, _value: False
    """Test of numbers that look absurd and are none: not a number where the eye was lost, say."""
    weight: float = 1.0
    """Its part of all inputs, against 1 of the others: less for what takes long."""


def _lost(_place: str, value: float) -> bool:
    """Depth, disparity and gaze say what is unknown by numbers that are not finite."""
    return not math.isfinite(value)


def _haze(place: str, value: float) -> bool:
    """A scene without haze sees infinitely far."""
    return place.endswith(".haze_m") and value > 0


def _gaze(place: str, value: float) -> bool:
    """Lost eyes, and blinks that began before the first sample."""
    return not math.isfinite(value) or place == ".blinks_s"


def _stamp(place: str, value: float) -> bool:
    """Moments on a clock whose zero is arbitrary; their order is held to the plan."""
    return math.isfinite(value) and place.endswith(("onset_s", "offset_s"))


def _anything(_place: str, _value: float) -> bool:
    """Numbers as they stand in the file: who reads on judges them."""
    return True


def _journal(path: Path) -> Any:
    strict = []
    try:
        strict = list(read_journal(path).events)
    finally:
        lenient = read_journal(path, lenient=True)
    return [strict, lenient.events]


def _sessions(path: Path) -> Any:
    study = load_protocol(Path("demo"))
    verify(SessionFolder(path.absolute().parent, read_journal(path, lenient=True)), study)
    tidy = read_sessions(path.parent.parent, study)
    return [tidy.attempts, tidy.decisions]


def _samples(path: Path) -> Any:
    return read_samples(
        path.parent, SideFile(file=path.name, sha256=sha256_bytes(path.read_bytes()))
    )


def _video(path: Path) -> Any:
    return list(read_frames(path, (16, 12), 3, 30.0))


def _spreadsheet(path: Path) -> Any:
    return read_spreadsheet(path, [])


def _network(path: Path) -> Any:
    return len(OnnxNetwork.files(path)), OnnxNetwork(path).value_range


def _denoising(path: Path) -> Any:
    return DenoisingNetwork(path).facts.levels


READERS: tuple[Reader, ...] = (
    Reader("picture-png", "p.png", mutations.PNG, read_picture),
    Reader("picture-jpeg", "p.jpg", mutations.RAW, read_any),
    Reader("picture-tiff", "p.tif", mutations.RAW, load_colour),
    Reader("picture-hdr", "p.hdr", mutations.RAW, read_any),
    Reader("frame-png", "p.png", mutations.PNG, decode_png),
    Reader("video", "v.avi", mutations.RAW, _video),
    Reader("video-mp4", "v.mp4", mutations.RAW, _video),
    Reader("video-mkv", "v.mkv", mutations.RAW, _video),
    Reader("depth-png", "d.png", mutations.PNG, partial(load_depth, scale=0.001)),
    Reader("exr-parts", "w.exr", mutations.RAW, read_parts, _anything),
    Reader("exr-warp-input", "w.exr", mutations.RAW, load_warp_input, _lost),
    Reader("exr-panorama", "around.exr", mutations.RAW, load_panorama, _lost),
    Reader("pfm", "d.pfm", mutations.PLAIN, load_plane, _anything),
    Reader("numpy-npy", "d.npy", mutations.RAW, load_plane, _anything),
    Reader("numpy-npz", "d.npz", mutations.ZIPPED, load_plane, _anything),
    Reader("flow-flo", "f.flo", mutations.RAW, read_flow),
    Reader("compressed", "c.metamer", mutations.RAW, lambda p: decompress(read_compressed(p))),
    Reader("baked-texture", "t.moments", mutations.RAW, read_baked),
    Reader("mesh-glb", "s.glb", mutations.GLB, load_world, _haze),
    Reader("mesh-gltf", "gltf/s.gltf", mutations.TREE, load_world, _haze),
    Reader("network-onnx", "net.onnx", mutations.RAW, _network, _anything, 0.05),
    Reader("denoising-onnx", "dn.onnx", mutations.RAW, _denoising, _anything, 0.05),
    Reader("pose", "poses.txt", mutations.PLAIN, lambda path: read_pose(f"{path}:2")),
    Reader("study-toml", "study.toml", mutations.STUDY, load_protocol),
    Reader("display-toml", "display.toml", mutations.STUDY, lambda path: load_toml(path, Display)),
    Reader("viewing-toml", "viewing.toml", mutations.STUDY, lambda path: open_viewing(str(path))),
    Reader("stimuli-csv", "stimuli.csv", mutations.PLAIN, read_stimuli, _anything),
    Reader("manifest", "manifest/manifest.json", mutations.TREE, lambda p: read_manifest(p.parent)),
    Reader("journal", "few/demo/S001/journal.jsonl", mutations.JOURNAL, _journal, _stamp),
    Reader("live-log", "live.jsonl", mutations.JOURNAL, read_log, _anything),
    Reader("sittings", "few/demo/S001/journal.jsonl", mutations.JOURNAL, _sessions, _lost, 0.1),
    Reader("gaze-of-a-sitting", "0001.csv", mutations.PLAIN, _samples),
    Reader("flips-of-a-sitting", "flips.csv", mutations.PLAIN, read_flips, _anything),
    Reader("gaze-of-live-flips", "0001.csv", mutations.PLAIN, gaze_by_stamp, _anything),
    Reader("gaze-csv", "g.csv", mutations.PLAIN, load_recording, _lost),
    Reader("gaze-csv-gz", "g.csv.gz", mutations.PACKED, load_recording, _lost),
    Reader("gaze-asc", "g.asc", mutations.PLAIN, load_recording, _gaze),
    Reader("gaze-points", "points.csv", mutations.PLAIN, lambda path: read_viewer_gaze(str(path))),
    Reader("decisions-csv", "decisions.csv", mutations.PLAIN, read_decisions, _lost, 0.3),
    Reader("table-xlsx", "old.xlsx", mutations.ZIPPED, _spreadsheet, _anything),
    Reader("table-ods", "old.ods", mutations.ZIPPED, _spreadsheet, _anything),
    Reader("trials-csv", "trials.csv", mutations.PLAIN, read_trials, _lost),
)


def write_xlsx(path: Path) -> None:
    """Write a workbook whose first part is its sheet, so that the attack harms what is read."""
    main = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    links = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    rows = (("who", "first", "second", "share"), ("p1", "ours", "blur", 0.5))
    lines = [
        f'<row r="{number}">'
        + "".join(
            f'<c r="{chr(65 + column)}{number}"><v>{value}</v></c>'
            if isinstance(value, float)
            else f'<c r="{chr(65 + column)}{number}" t="inlineStr"><is><t>{value}</t></is></c>'
            for column, value in enumerate(row)
        )
        + f'<c r="E{number}" t="s"><v>0</v></c></row>'
        for number, row in enumerate(rows, 1)
    ]
    files = {
        "xl/worksheets/sheet1.xml": f"<worksheet {main}><sheetData>{''.join(lines)}</sheetData>"
        "</worksheet>",
        "xl/workbook.xml": f'<workbook {main} xmlns:r="{links}"><sheets><sheet name="Data"'
        ' r:id="r1"/></sheets></workbook>',
        "_rels/.rels": f'<Relationships><Relationship Id="r" Type="{links}/officeDocument"'
        ' Target="xl/workbook.xml"/></Relationships>',
        "xl/_rels/workbook.xml.rels": '<Relationships><Relationship Id="r1"'
        f' Type="{links}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>',
        "xl/sharedStrings.xml": f"<sst {main}><si><t>note</t></si></sst>",
    }
    with zipfile.ZipFile(path, "w") as packed:
        for name, text in files.items():
            packed.writestr(name, text)


_ODS = " ".join(
    f'xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"'
    for name in ("office", "table", "text")
)


def write_ods(path: Path, *rows: str) -> None:
    """Write a spreadsheet as LibreOffice does, of rows as it writes them."""
    told = '<table:table-cell office:value-type="string"><text:p>who</text:p></table:table-cell>'
    half = '<table:table-cell office:value-type="float" office:value="0.5"/>'
    lines = "".join(f"<table:table-row>{row}</table:table-row>" for row in rows or (told, half))
    text = f'<table:table table:name="Data">{lines}</table:table>'
    for name in ("spreadsheet", "body", "document-content"):
        named = f" {_ODS}" if name == "document-content" else ""
        text = f"<office:{name}{named}>{text}</office:{name}>"
    with zipfile.ZipFile(path, "w") as packed:
        packed.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        packed.writestr("content.xml", text)
        packed.writestr("META-INF/manifest.xml", "<manifest/>")


def write_samples(folder: Path) -> None:
    """Write a whole file of every kind that `READERS` names."""
    rng = np.random.default_rng(7)
    width, height = SIZE
    picture = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    for name in ("p.png", "p.jpg", "p.tif"):
        Image.fromarray(picture).save(folder / name)
    write_pixels(folder / "p.hdr", rng.random((height, width, 3), np.float32), ("R", "G", "B"))
    depth = rng.uniform(1, 4, (height, width)).astype(np.float32)
    Image.fromarray((1000 * depth).astype(np.uint16)).save(folder / "d.png")
    planes = np.dstack([rng.random((height, width, 3), np.float32), depth,
                        rng.normal(0, 2, (height, width, 2)).astype(np.float32)])  # fmt: skip
    write_pixels(folder / "w.exr", planes, ("R", "G", "B", "Z", "flow.x", "flow.y"))
    write_pixels(folder / "around.exr", np.full((8, 16, 4), 0.5, np.float32), "RGBZ")
    head = f"Pf\n{width} {height}\n-1.0\n".encode()
    (folder / "d.pfm").write_bytes(head + depth.tobytes())
    np.save(folder / "d.npy", depth)
    np.savez(folder / "d.npz", depth)
    write_flo(folder / "f.flo", planes[..., 4:])
    compressed = compress([picture / np.float32(255)], (9.0, 5.0), CompressedAs(angles=32))
    (folder / "c.metamer").write_bytes(to_bytes(compressed))
    with (folder / "t.moments").open("w+b") as file:
        write_baked(file, Layout(width, height), strips(picture))
    for ending, codec in ((".avi", "MJPG"), (".mp4", "mp4v"), (".mkv", "FFV1")):
        fourcc = cv2.VideoWriter.fourcc(*codec)
        video = cv2.VideoWriter(str(folder / f"v{ending}"), fourcc, 30, (16, 12))
        for _ in range(3):
            video.write(rng.integers(0, 256, (12, 16, 3), dtype=np.uint8))
        video.release()
    _write_meshes(folder, picture)
    _write_network(folder / "net.onnx")
    channels = (4, *[2] * 7, 28)
    layers = [(np.ones((out, taken, 3, 3), np.float32), np.ones(out, np.float32))
              for taken, out in pairwise(channels)]  # fmt: skip
    (folder / "dn.onnx").write_bytes(to_onnx(layers, NetworkFacts("moments")))
    _write_tables(folder, rng)
    _write_studies(folder)
    _write_live_log(folder / "live.jsonl")
    _write_live_flips(folder / "flips.csv")


def _write_live_log(path: Path) -> None:
    """A log of three frames, whose pixels were not kept."""
    log = LiveLog(
        path, at="2026-01-01T00:00:00.000000Z", source="p.png", reading=vars(PictureReading()),
        gaze="mouse", display=load_display("fhd27-60hz").model_dump(mode="json"), renderer="r",
        driver="1", revision="0", refresh_hz=60.0, every=30,
    )  # fmt: skip
    log.choice(
        RendererDescription(
            source_sha256="0" * 64,
            panorama=False,
            size_px=(20, 14),
            centre_px=(10.0, 7.0),
            distance_px=30.0,
            method="metamer",
            parameters={"law": "v2"},
        )
    )
    log.next_kept = 3
    latency = Latency()
    gaze_state = GazeState((3.0625, 4.5), (3.0, 4.5), 5)
    for n in range(3):
        t_s = 10 + n / 60
        flip = DrawnFlip(
            n, t_s, t_s - 0.01, t_s - 0.004, int(n > 0), LiveView(), gaze_state, "found", t_s - 0.02
        )
        latency.add(flip.eye, flip.age_s)
        log.flip(flip, None)
    log.end(flips=3, missed=0, left_out=0, latency=latency.summary().model_dump(mode="json"))
    log.close()


def _write_live_flips(path: Path) -> None:
    """Flips of one trial, three of them of a stimulus that follows the gaze."""
    header = FLIPS_HEADER + LIVE_HEADER
    blank = "7,0.100000,,1,regular,0.000000,virtual,fixation,," + "," * LIVE_HEADER.count(",")
    lines = [
        f"{n},{n / 60:.6f},0.016667,1,regular,0.000000,virtual,stimulus,0,{'0' * 64},"
        f"3.0625,4.5,3.0,4.5,0.012000,found,5,{'1' * 64},{'2' * 64 if n == 10 else ''},"
        f"{'A' * 1024 if n == 10 else ''},0"
        for n in range(8, 11)
    ]
    path.write_text("\n".join([header, blank, *lines, ""]), encoding="ascii")


def _write_meshes(folder: Path, picture: Any) -> None:
    uv = np.random.default_rng(3).random((8, 2))
    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(uv=uv, image=Image.fromarray(picture))
    scene = trimesh.Scene([box, trimesh.creation.icosphere(subdivisions=1)])
    (folder / "s.glb").write_bytes(scene.export(file_type="glb"))
    (folder / "gltf").mkdir()
    for name, data in scene.export(file_type="gltf").items():
        (folder / "gltf" / ("s.gltf" if name.endswith(".gltf") else name)).write_bytes(data)


def _write_network(path: Path) -> None:
    import onnx
    from onnx import TensorProto, helper

    shapes = (("image", [1, 3, "H", "W"]), ("mask", [1, 1, "H", "W"]), ("out", [1, 3, "H", "W"]))
    *inputs, out = (helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in shapes)
    half = helper.make_tensor("half", TensorProto.FLOAT, [1], [0.5])
    nodes = [helper.make_node("Mul", ["mask", "half"], ["shift"]),
             helper.make_node("Add", ["image", "shift"], ["out"])]  # fmt: skip
    graph = helper.make_graph(nodes, "net", inputs, [out], initializer=[half])
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=9), path)


def _write_tables(folder: Path, rng: np.random.Generator) -> None:
    times = np.arange(40) * 0.004
    gaze = [
        f"{t:.3f},{x:.2f},{y:.2f}"
        for t, (x, y) in zip(times, rng.normal(500, 9, (40, 2)), strict=True)
    ]
    gaze[7] = "0.028,,"
    text = "t_s,x_px,y_px\n" + "\n".join(gaze) + "\n"
    (folder / "g.csv").write_text(text)
    (folder / "g.csv.gz").write_bytes(gzip.compress(text.encode(), 1))
    (folder / "points.csv").write_text("x_px,y_px\n1.5,2\n3,4\n5,6\n")
    rows = [f"{100 + 4 * n}\t{500 + n}.1\t{400 - n}.2\t900.0\t..." for n in range(30)]
    rows[9] = "136\t   .\t   .\t0.0\t..."
    (folder / "g.asc").write_text(
        "** CONVERTED\nMSG\t90 GAZE_COORDS 0.00 0.00 1919.00 1079.00\n"
        "START\t100 \tLEFT\tSAMPLES\nSAMPLES\tGAZE\tLEFT\tRATE\t 250.00\tTRACKING\tCR\n"
        + "\n".join(rows) + "\nEBLINK L 136\t136\t4\nEND\t220 \tSAMPLES\n"
    )  # fmt: skip
    (folder / "0001.csv").write_text(
        "t_s,raw_t,x_px,y_px\n" + "".join(f"{n * 0.004:.6f},{n}.5,{n},2.25\n" for n in range(20))
    )
    (folder / "poses.txt").write_text("# x\n1 0.5 0 0 0 0 0 1\n2 1 0 0 0 0.6 0 0.8\n")
    (folder / "stimuli.csv").write_text(
        "stimulus,file,scene,level\n" + "".join(f"s{n},s{n}.png,one,{n / 4}\n" for n in range(6))
    )
    write_xlsx(folder / "old.xlsx")
    write_ods(folder / "old.ods")
    (folder / "decisions.csv").write_text(
        "participant,first,second,chosen,scene,rt_s\n"
        + "".join(f"P{n % 3},a,b,{'ab'[n % 2]},one,{0.4 + n / 10}\n" for n in range(12))
    )
    (folder / "trials.csv").write_text(
        "participant,expected,answer,level,rt_s,order\n"
        + "".join(
            f"P{n % 3},yes,{('yes', 'no')[n % 2]},{n / 8},{0.4 + n / 10},{n}\n" for n in range(12)
        )
    )


def _write_studies(folder: Path) -> None:
    shutil.copy(shipped("studies")["demo"], folder / "study.toml")
    shutil.copy(shipped("displays")["fhd27-60hz"], folder / "display.toml")
    shutil.copy(shipped("displays")["fhd27-60hz"], folder / "viewing.toml")
    study = load_protocol(Path("demo"))
    display = load_display(study.display.display)
    (folder / "manifest").mkdir()
    manifest = virtual_manifest(study, display)
    kept = [
        clip.model_copy(update={"frames_sha256": clip.frames_sha256[:2]}) for clip in manifest.clips
    ]
    write_manifest(folder / "manifest", manifest.model_copy(update={"clips": tuple(kept)}))
    simulate_study(SimulatedStudy(study, display, gaze=STEADY, gaze_rate_hz=30), folder, 1)
    whole = folder / "demo" / "S001" / "journal.jsonl"
    few = folder / "few" / "demo" / "S001"
    few.mkdir(parents=True)
    few.joinpath("journal.jsonl").write_bytes(
        b"".join(line + b"\n" for line in whole.read_bytes().split(b"\n")[:30])
    )
    for beside in ("gaze", "flips"):
        shutil.rmtree(whole.parent / beside, ignore_errors=True)


_NEVER_NEGATIVE = ("_hz", "width_px", "height_px", "size_px", "_share", "frames", "repeats")
_TIMES = "_s"


def absurd(value: Any, reader: Reader) -> str | None:
    """Return the first number of what was read that cannot be meant, with its place."""
    for place, number in _numbers(value, ""):
        low = number < 0 and place.endswith((*_NEVER_NEGATIVE, _TIMES))
        if (not math.isfinite(number) or low) and not reader.may_be(place, number):
            return f"{place} = {number!r}"
    return None


def _numbers(value: Any, place: str) -> Iterator[tuple[str, float]]:
    """Yield what is not finite, and what is negative, with its place; of an array the first."""
    if isinstance(value, bool | str | bytes | None.__class__):
        return
    if isinstance(value, int | float | np.integer | np.floating):
        if not (isinstance(value, int) or math.isfinite(value)) or value < 0:
            yield place, float(max(min(value, 1e300), -1e300) if isinstance(value, int) else value)
    elif isinstance(value, np.ndarray):
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            yield place, float(value[~np.isfinite(value)][0])
        if value.dtype.kind in "fi" and (value < 0).any():
            yield place, float(value[value < 0][0])
    elif isinstance(value, pd.DataFrame):
        for name in value.columns:
            if value[name].dtype.kind in "fi":
                yield from _numbers(value[name].to_numpy(), f"{place}.{name}")
    elif isinstance(value, dict):
        for key, entry in value.items():
            yield from _numbers(entry, f"{place}.{key}")
    elif isinstance(value, list | tuple):
        names = getattr(value, "_fields", None) or range(len(value))
        for key, entry in zip(names, value, strict=True):
            yield from _numbers(entry, f"{place}.{key}" if isinstance(key, str) else place)
    elif isinstance(value, BaseModel):
        for key in type(value).model_fields:
            yield from _numbers(getattr(value, key), f"{place}.{key}")
    elif dataclasses.is_dataclass(value):
        for entry in dataclasses.fields(value):
            yield from _numbers(getattr(value, entry.name), f"{place}.{entry.name}")
