"""The plate of fills against values worked by hand, and fills of clips that use it."""

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame
from pipeline.frame_textures import FrameTextures
from pipeline.methods.registry import create_method
from pipeline.plate.reference import KeptFills
from stimuli.batch.clip import Fills

THRESHOLD = 0.04


def view(columns, motion_px, depth_m=4.0, size=(3, 16), grey=0.5) -> WarpedFrame:
    """A background that moved by `motion_px` to the right; holes in `columns`."""
    hole = np.zeros(size, bool)
    hole[:, columns] = True
    flow_px = np.full((*size, 2), (motion_px, 0.0), np.float32)
    colour = np.full((*size, 3), grey, np.float32)
    return WarpedFrame(colour, np.full(size, depth_m, np.float32), hole, flow_px)


def ramp(frame: WarpedFrame, first: float) -> np.ndarray:
    """A fill that rises by 1/64 a column."""
    values = first + np.arange(frame.size[1]) / 64
    return np.where(frame.hole[..., None], values[None, :, None], frame.colour).astype(np.float32)


class Ramps:
    """A plate whose fills are ramps, from the grey that each view says."""

    def __init__(self) -> None:
        self._kept = KeptFills(lambda frame, *_: ramp(frame, self._first), THRESHOLD)

    def __call__(self, frame: WarpedFrame, first: float) -> list[float]:
        self._first = first
        return (64 * self._kept.fill(frame)[1, :, 0]).tolist()


def test_a_place_keeps_the_colour_that_it_got_first():
    """By hand: columns 4 to 7 got 4 to 7; moved by 2 px they are columns 6 to 9, and 10 is new."""
    settled = Ramps()

    first = settled(view(slice(4, 8), 0.0), 0.0)
    second = settled(view(slice(6, 11), 2.0), 0.5)

    assert first[4:8] == [4, 5, 6, 7]
    assert second[6:11] == [4, 5, 6, 7, 42]
    assert second[5] == second[11] == 32  # known pixels


def test_between_texels_colours_are_interpolated():
    """Half a pixel on, a pixel lies between what 4 and 5 got; a ramp stays a ramp."""
    settled = Ramps()
    settled(view(slice(4, 9), 0.0), 0.0)

    found = settled(view(slice(5, 9), 0.5), 0.0)

    assert found[5:9] == [4.5, 5.5, 6.5, 7.5]


@pytest.mark.parametrize(("depth_m", "kept"), [(4.1, True), (4.3, False), (np.inf, False)])
def test_another_surface_does_not_take_the_place(depth_m, kept):
    """4 m and 4.1 m differ by 2.4 %, 4 m and 4.3 m by 7 %."""
    settled = Ramps()
    settled(view(slice(4, 8), 0.0), 0.0)

    found = settled(view(slice(4, 8), 0.0, depth_m), 0.5)

    assert found[4:8] == ([4, 5, 6, 7] if kept else [36, 37, 38, 39])


def test_two_places_at_infinity_are_of_one_surface():
    settled = Ramps()
    settled(view(slice(4, 8), 0.0, np.inf), 0.0)

    assert settled(view(slice(4, 8), 0.0, np.inf), 0.5)[4:8] == [4, 5, 6, 7]


def test_places_beyond_the_margin_keep_their_own_fill():
    """The margin is a quarter of 16 px; the background of these holes came from 40 px aside."""
    settled = Ramps()

    for first in (0.0, 0.5):
        found = settled(view(slice(4, 8), 40.0), first)
        assert found[4:8] == [64 * first + k for k in range(4, 8)]


def test_what_is_kept_counts_as_known_before_the_rest_is_filled():
    """Columns 4 to 7 are kept; of 4 to 9 the filler is asked for 8 and 9, and sees the others."""
    asked = []

    def fill(frame: WarpedFrame, weight: np.ndarray, _seed: int) -> np.ndarray:
        assert ((weight == 0) == frame.hole).all()
        asked.append((np.flatnonzero(frame.hole[1]).tolist(), frame.colour[1, 4, 0]))
        return np.where(frame.hole[..., None], np.float32(0.25), frame.colour)

    plate = KeptFills(fill, THRESHOLD)
    plate.fill(view(slice(4, 8), 0.0))
    plate.fill(view(slice(4, 10), 0.0))

    assert asked == [([4, 5, 6, 7], 0.0), ([8, 9], 0.25)]


def test_known_pixels_keep_their_bits(rng):
    frame = view(slice(4, 8), 0.25)
    colour = rng.random(frame.colour.shape, np.float32)
    frame = WarpedFrame(colour, frame.depth_m, frame.hole, frame.flow_px)

    found = KeptFills(lambda *_: rng.random(colour.shape, np.float32), THRESHOLD).fill(frame)

    assert found[~frame.hole].tobytes() == colour[~frame.hole].tobytes()


# --- fills of a clip ------------------------------------------------------------------------


class Gliding:
    """Views of noise that glides behind a foreground, from two sources."""

    def __init__(self, ctx=None) -> None:
        self.plane = np.random.default_rng(2).random((32, 96, 3), np.float32)
        self._ctx, self._textures = ctx, None

    def warped_textures(self, frame: int) -> FrameTextures:
        """The textures of the last frame are overwritten, as a footage's are."""
        if self._textures is None:
            self._textures = FrameTextures.of(self._ctx, self.warped(frame))
        self._textures.upload(self.warped(frame))
        return self._textures

    def source_key(self, frame: int) -> int:
        return frame // 3

    def warped(self, frame: int) -> WarpedFrame:
        by = 0.6 * (frame % 3)
        nearer = np.zeros((32, 64), bool)
        nearer[:, :16] = True
        hole = np.zeros((32, 64), bool)
        hole[:, 16:26] = True
        depth_m = np.where(nearer, 2.0, 5.0).astype(np.float32)
        flow_px = np.where(nearer[..., None], (by - 12.0, 0.0), (by, 0.0)).astype(np.float32)
        colour = self.plane[:, 8 - round(by) :][:, :64].copy()
        return WarpedFrame(colour, depth_m, hole, flow_px, frame)


@pytest.fixture(scope="module")
def method(module_gl_context):
    made = create_method("coherence-transport", module_gl_context, {"detail": 1.0})
    yield made
    made.release()


@pytest.fixture(scope="module")
def views(module_gl_context):
    return Gliding(module_gl_context)


@pytest.fixture(scope="module")
def in_sequence(method, views):
    fills = Fills(method, views, 1)
    return [fills.frame(k) for k in range(6)]


@pytest.mark.parametrize("order", [[5], [2, 5, 4], [4, 1]])
def test_frame_k_alone_is_frame_k_of_a_sequence(method, views, in_sequence, order):
    fills = Fills(method, views, 1)

    for k in order:
        assert fills.frame(k).tobytes() == in_sequence[k].tobytes()


def test_the_first_view_of_a_source_has_the_methods_own_fill_and_later_ones_have_not(
    method, views, in_sequence
):
    own = [method.fill(views.warped(k), 1) for k in range(5)]

    assert (own[0] == in_sequence[0]).all()
    assert (own[3] == in_sequence[3]).all()
    assert (own[1] != in_sequence[1]).any()
    assert (own[4] != in_sequence[4]).any()


def test_a_clip_is_the_same_as_by_arrays(method, views, in_sequence):
    """By the numpy twin of the plate, around the same fills."""
    plate = KeptFills(lambda frame, *_: method.fill(frame, 1), THRESHOLD)
    for k in range(3):
        assert plate.fill(views.warped(k)).tobytes() == in_sequence[k].tobytes()
    assert (in_sequence[2] != method.fill(views.warped(2), 1)).any()


def test_a_new_source_frees_the_plate_of_the_last(method, views):
    fills = Fills(method, views, 1)
    fills.frame(0)
    plate = fills._plate
    assert plate.held
    fills.frame(3)
    assert not plate.held
    fills.release()
    assert fills._plate is None


class Arrays:
    """A method of another package, whose plate takes arrays."""

    def fill(self, warped: WarpedFrame, seed: int) -> np.ndarray:
        return np.where(warped.hole[..., None], np.float32(0.25 + seed), warped.colour)

    def release(self) -> None: ...

    def new_plate(self) -> KeptFills:
        return KeptFills(lambda frame, *_: self.fill(frame, 0), THRESHOLD)


def test_a_method_of_arrays_has_a_plate_of_arrays():
    found = Fills(Arrays(), Gliding(), 0).frame(1)

    assert (found[:, 16:26] == 0.25).all()


def test_a_plate_that_does_not_fill_is_refused():
    class Nothing(Arrays):
        def new_plate(self) -> object:
            return object()

    with pytest.raises(InputError, match=r"a plate must have fill.*got object\); mend the method"):
        Fills(Nothing(), Gliding(), 0).frame(1)


@pytest.mark.parametrize("name", ["settle", "settle_textures"])
def test_a_plate_that_settles_finished_fills_is_told_what_it_does_now(name):
    """As plates of other packages did up to revision 70b3711."""
    old = type("Old", (), {name: lambda *_: None, "release": lambda _: None})

    class Settling(Arrays):
        def new_plate(self) -> object:
            return old()

    said = rf"got Old, which has {name}\); mend.*where settle took the finished fill"
    with pytest.raises(InputError, match=said):
        Fills(Settling(), Gliding(), 0).frame(1)


def test_a_method_without_a_plate_fills_every_frame_by_itself():
    method, views = create_method("background-extension"), Gliding()

    found = Fills(method, views, 1).frame(2)

    assert found.tobytes() == method.fill(views.warped(2), 1).tobytes()
