"""Of two channels that fit one question none is taken unasked, for the picture and its truth."""

import re
import warnings

import numpy as np
import odd_pictures as odd
import pytest

from pipeline.errors import InputError
from pipeline.pictures.channels import Channels
from pipeline.pictures.colour_file import PictureReading, load_colour, read_any
from pipeline.pictures.decode import read_parts
from pipeline.pictures.warp_input import load_warp_input
from protocols.recipes.warped_clips import CirclePath, ExrScene
from stimuli.scenes.sequence import load_picture

SIZE = (6, 8)
CIRCLE = CirclePath(kind="circle")


def flat(value):
    return np.full(SIZE, value, np.float32)


def colour(layer, value):
    return {f"{layer}{name}": flat(value) for name in "RGB"}


def scene(**more):
    return ExrScene(kind="exr", name="s", file="-", camera=CIRCLE, transfer="linear", **more)


def figures(depth=2.0):
    return {
        **colour("Figures.Combined.", 0.25),
        "Figures.Depth.Z": flat(depth),
        "Figures.Vector.Z": flat(-3),
        "Figures.Vector.W": flat(0),
    }


@pytest.mark.parametrize("first", ["Backdrop", "Zoo"])
def test_colour_and_motion_go_with_the_layer_that_depth_comes_from(tmp_path, first):
    """Layers in any order of the file; the layer alone is the control."""
    other = {f"{first}.Vector.Z": flat(-9), f"{first}.Vector.W": flat(0)}
    odd.write_exr(tmp_path / "a.exr", {**colour(f"{first}.Combined.", 0.9), **other, **figures()})
    odd.write_exr(tmp_path / "control.exr", figures())
    path, control = tmp_path / "a.exr", tmp_path / "control.exr"

    found, wanted = load_warp_input(path), load_warp_input(control)

    np.testing.assert_array_equal(found.source.colour, wanted.source.colour)
    np.testing.assert_array_equal(found.flow_px, wanted.flow_px)
    picture = load_picture(path, scene())
    assert picture.frame.colour[0, 0, 0] == 0.25
    assert picture.motion.flow_px[0, 0, 0] == 3
    for read in (load_colour, lambda one: read_any(one).colour):  # a truth, a picture to foveate
        np.testing.assert_array_equal(read(path), read(control))


TWO = [
    ({"Z": flat(2), "depth.Z": flat(3)}, "depth", ("Z", "depth.Z")),
    ({"A.Depth.Z": flat(2), "B.Depth.Z": flat(3)}, "depth", ("A.Depth.Z", "B.Depth.Z")),
    ({"Z": flat(2), "FinalImageMovieRenderQueue_WorldDepth.R": flat(2)}, "depth",
     ("Z", "FinalImageMovieRenderQueue_WorldDepth.R")),
    ({"Y.Depth.Z": flat(2), "X.Combined.R": flat(0.5)}, "r", ("R", "X.Combined.R")),
    ({"Z": flat(2), "forward.u": flat(1), "forward.v": flat(0)}, "motion_x and motion_y",
     ("flow.x with flow.y", "forward.u with forward.v")),
    ({"Y.Depth.Z": flat(2), "A.Vector.Z": flat(1), "A.Vector.W": flat(0), "B.Vector.Z": flat(2),
      "B.Vector.W": flat(0)}, "motion_x and motion_y",
     ("flow.x with flow.y", "A.Vector.Z with A.Vector.W", "B.Vector.Z with B.Vector.W")),
]  # fmt: skip
OPTION = re.compile(r"--channel (\S+?)=(\S+?)[;, ]")


@pytest.mark.parametrize(("more", "asked", "both"), TWO)
def test_two_that_fit_are_refused_with_both_names_and_the_option_that_chooses(
    tmp_path, more, asked, both
):
    path = tmp_path / "a.exr"
    planes = {**colour("", 0.25), "flow.x": flat(3), "flow.y": flat(0), **more}
    odd.write_exr(path, planes)

    with pytest.raises(InputError, match=f"must have one channel for {asked}") as told:
        load_warp_input(path)
    said = str(told.value)
    for name in both:
        assert name in said
    with pytest.raises(InputError, match=f"must have one channel for {asked}"):
        load_picture(path, scene())

    # The cure, from the message's own words: the option, and the study's entry.
    chosen = {what: (name,) for what, name in OPTION.findall(said + " ")}
    entries = dict(re.findall(r'(\w+) = "([^"]+)"', said))
    assert load_warp_input(path, channels=Channels(**chosen)) is not None
    assert load_picture(path, scene(channels=entries)) is not None


def test_two_that_hold_the_same_are_one(tmp_path):
    planes = {**colour("", 0.25), "Z": flat(2), "depth.Z": flat(2), "flow.x": flat(3)}
    odd.write_exr(tmp_path / "a.exr", {**planes, "flow.y": flat(0)})

    assert load_warp_input(tmp_path / "a.exr").source.depth_m[0, 0] == 2


def test_parts_with_channels_of_one_name_are_told_apart(tmp_path):
    """Blender, V-Ray: a part per layer, all with R, G, B. Figures alone has depth."""
    motion = {"flow.x": flat(3), "flow.y": flat(0)}
    parts = {"Backdrop": colour("", 0.9), "Figures": {**colour("", 0.25), "Z": flat(2), **motion}}
    odd.write_parts(tmp_path / "a.exr", parts)
    odd.write_parts(
        tmp_path / "b.exr", {"one": colour("", 0.9), "two": colour("", 0.25), "far": {"Z": flat(2)}}
    )

    assert load_picture(tmp_path / "a.exr", scene()).frame.colour[0, 0, 0] == 0.25
    found = load_warp_input(tmp_path / "a.exr")
    np.testing.assert_array_equal(found.source.colour, load_colour(tmp_path / "a.exr"))
    for read in (load_colour, read_any, lambda path: load_picture(path, scene())):
        with pytest.raises(InputError, match=r"one channel for r \(these fit: one\.R; two\.R\)"):
            read(tmp_path / "b.exr")
    told = Channels(red=("two.R",), green=("two.G",), blue=("two.B",))
    assert load_colour(tmp_path / "b.exr", channels=told)[0, 0, 0] < 0.6


def test_a_truth_is_read_as_the_picture_is(tmp_path):
    """Depth and motion in the truth's file are left out."""
    planes = {**colour("", 0.25), "Z": flat(2), "flow.x": flat(3), "flow.y": flat(0)}
    odd.write_exr(tmp_path / "a.exr", planes)
    odd.write_exr(tmp_path / "plain.exr", colour("", 0.25))
    odd.write_exr(tmp_path / "clear.exr", {**planes, "A": flat(0.5)})

    wanted = load_colour(tmp_path / "plain.exr")

    np.testing.assert_array_equal(load_colour(tmp_path / "a.exr"), wanted)
    np.testing.assert_array_equal(load_warp_input(tmp_path / "a.exr").source.colour, wanted)
    with pytest.raises(InputError, match="must be opaque"):
        load_colour(tmp_path / "clear.exr")


@pytest.mark.parametrize("layer", ["", "Figures.Combined.", "FinalImage."])
@pytest.mark.parametrize("parts", [False, True])
def test_transparent_colour_is_refused_by_each_reader_and_other_alpha_is_none_of_its(
    tmp_path, layer, parts
):
    path = tmp_path / "a.exr"
    rest = {"flow.x": flat(3), "flow.y": flat(0), "Z": flat(2)}

    def write(alpha):
        near = {**colour(layer, 0.25), f"{layer}A": flat(alpha), **rest}
        if parts:
            odd.write_parts(path, {"near": near, "matte": {"A": flat(0.5)}})
        else:
            odd.write_exr(path, {**near, "matte.A": flat(0.5)})

    write(1)
    for read in (load_colour, load_warp_input, lambda one: load_picture(one, scene())):
        assert read(path) is not None
    plain = read_any(path).colour
    write(0.5)
    for read in (load_colour, load_warp_input, lambda one: load_picture(one, scene())):
        with pytest.raises(InputError, match="must be opaque"):
            read(path)
    assert (read_any(path).colour != plain).all()


def test_colour_alone_asks_about_no_depth_and_names_options_that_are_there(tmp_path):
    path = tmp_path / "a.exr"
    planes = {**colour("", 0.25), "Z": flat(2), "depth.Z": flat(3)}
    odd.write_exr(path, planes)

    np.testing.assert_array_equal(load_colour(path), read_any(path).colour)

    odd.write_exr(path, planes, **{"oiio:ColorSpace": "srgb_rec709_scene"})
    with pytest.raises(InputError, match=r"save it as PNG, or .* --encoded of warp and foveate"):
        read_any(path)
    assert read_any(path, PictureReading(encoded=True)).colour[0, 0, 0] == 0.25

    odd.write_exr(path, {name: 3 * plane for name, plane in colour("", 0.5).items()})
    with pytest.raises(InputError, match=r"1\.5\); lower its exposure, or save it as PNG$"):
        read_any(path)
    with pytest.raises(InputError, match=r"darken it by --stops .* clip it with --clip$"):
        read_any(path, PictureReading())


def test_a_scene_hears_what_the_header_says_of_transfer_and_unit(tmp_path):
    planes = {**colour("", 0.25), "Z": flat(2)}
    odd.write_exr(tmp_path / "a.exr", planes, **{"metamerlab:transfer": "encoded"})
    odd.write_exr(tmp_path / "b.exr", planes, **{"metamerlab:depth_unit": "mm"})
    encoded_twice = scene().model_copy(update={"transfer": "srgb"})

    assert load_picture(tmp_path / "a.exr", scene()).frame.colour[0, 0, 0] == 0.25
    with pytest.raises(InputError, match='say transfer = "linear"'):
        load_picture(tmp_path / "a.exr", encoded_twice)
    with pytest.raises(InputError, match="depth must be in metres"):
        load_picture(tmp_path / "b.exr", scene())
    assert load_picture(tmp_path / "b.exr", scene(depth_scale=0.001)).frame.depth_m[0, 0] < 0.01


def test_a_second_view_is_noted_and_not_taken(tmp_path):
    planes = {**colour("", 0.25), **colour("right.", 0.9)}
    odd.write_exr(tmp_path / "a.exr", planes)
    plain = load_colour(tmp_path / "a.exr")
    raw = (tmp_path / "a.exr").read_bytes()
    assert plain.max() < 0.6
    assert raw[:4] == b"v/1\x01"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert set(read_parts(tmp_path / "a.exr").planes) == set(planes)
