"""`onnx:FILE`: any inpainting network exported to ONNX, run by ONNX Runtime on the CPU.

The network takes the image and the mask, either as two inputs of 3 and 1 channels or as one
input of 4, float32 and channels first: (1, C, H, W). The mask is 1 in holes, where the image
is 0. Its first output is the completed image, (1, 3, H, W), in the same range.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.frame import WarpedFrame, check_some_known
from pipeline.methods.method import composite
from pipeline.methods.onnx_files import (
    BoundedNetwork,
    NetworkError,
    network_files,
    on_one_line,
    open_session,
)
from protocols.errors import must_be_one_of
from protocols.outside import reading

_RANGES = {"0..1": (0.0, 1.0), "-1..1": (-1.0, 1.0)}
_CURE = "export it as described in the documentation of the method onnx:FILE"


class OnnxNetwork:
    """A network from `path`.

    Parameters
    ----------
    path : Path
    value_range : {"0..1", "-1..1"}
        How the network wants colours, and gives them back.
    multiple_px : int
        Height and width are padded to a multiple of this, by repeating the border, and cut
        back afterwards; most networks with strides need it.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    InputError
        If ONNX Runtime is not installed, the file is no model, or its inputs and outputs
        are not as described above.
    """

    def __init__(self, path: Path, *, value_range: str = "0..1", multiple_px: int = 8) -> None:
        if value_range not in _RANGES:
            raise InputError(must_be_one_of("value_range", value_range, _RANGES))
        if not 1 <= multiple_px <= 1024:
            raise InputError(f"multiple_px must lie in 1..1024 (got {multiple_px})")
        self.path = path
        self.value_range = value_range
        self.multiple_px = multiple_px
        self._session = open_session(path, "methods of the kind onnx:FILE need")
        with reading(path, "an ONNX model", InputError):  # its names may be no text
            self._inputs = _understand(path, self._session)

    @staticmethod
    def files(path: Path) -> list[Path]:
        """Return the network's file and the files of weights that it names."""
        return network_files(path)

    def check_size(self, size: tuple[int, int]) -> None:
        """Refuse frames, (height, width), that the network does not take; nothing is run.

        Raises
        ------
        InputError
            With the size that it takes.
        """
        height, width = (edge + -edge % self.multiple_px for edge in size)
        self._inputs.check_size(self.path, height, width)

    def fill(self, warped: WarpedFrame, seed: int) -> NDArray[np.float32]:  # noqa: ARG002
        """Fill the holes with what the network shows there."""
        check_some_known(warped.hole)
        low, high = _RANGES[self.value_range]
        height, width = warped.size
        below, right = -height % self.multiple_px, -width % self.multiple_px
        self._inputs.check_size(self.path, height + below, width + right)
        image = np.where(warped.hole[..., None], 0, low + (high - low) * warped.colour)
        planes = np.concatenate([image, warped.hole[..., None]], axis=-1).astype(np.float32)
        padded = np.pad(planes, ((0, below), (0, right), (0, 0)), mode="edge")
        feed = self._inputs.feed(padded.transpose(2, 0, 1)[None])
        try:
            (output,) = self._session.run([self._session.outputs[0].name], feed)
        except NetworkError as error:
            raise InputError(
                f"{self.path}: the network must run on {width + right} x {height + below} px"
                f" (ONNX Runtime says: {on_one_line(error)}); try another multiple_px"
            ) from error
        wanted = (1, 3, height + below, width + right)
        if output.shape != wanted or output.dtype.kind != "f":
            raise InputError(
                f"{self.path}: the output must have shape {wanted}, of floats (has {output.shape}"
                f" of {output.dtype}); {_CURE}"
            )
        colour = (output[0].transpose(1, 2, 0)[:height, :width] - low) / (high - low)
        return composite(warped, colour)

    def release(self) -> None:
        """Hold nothing on the GPU."""


@dataclass(frozen=True)
class _Inputs:
    """Planes R, G, B, mask that go into each input."""

    planes: dict[str, slice]
    height: int | None  # None: any
    width: int | None

    def check_size(self, path: Path, height: int, width: int) -> None:
        if (self.height or height, self.width or width) != (height, width):
            raise InputError(
                f"{path}: the network takes images of {self.width or 'any'} x"
                f" {self.height or 'any'} px only (the padded frame has {width} x {height});"
                " export it with variable height and width"
            )

    def feed(self, planes: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        return {
            name: np.ascontiguousarray(planes[:, chosen]) for name, chosen in self.planes.items()
        }


def _understand(path: Path, session: BoundedNetwork) -> _Inputs:
    inputs = session.inputs
    shapes = {item.name: tuple(item.shape or ()) for item in inputs}
    described = ", ".join(f"{item.name[:40]} {item.type} {item.shape}" for item in inputs[:4])
    channels = {name: shape[1] if len(shape) == 4 else None for name, shape in shapes.items()}
    by_count = {count: name for name, count in channels.items() if isinstance(count, int)}
    if len(channels) == 1 and set(by_count) == {4}:
        planes = {by_count[4]: slice(0, 4)}
    elif len(channels) == 2 and set(by_count) == {1, 3}:
        planes = {by_count[3]: slice(0, 3), by_count[1]: slice(3, 4)}
    else:
        planes = {}
    if not planes or any(item.type != "tensor(float)" for item in inputs):
        raise InputError(
            f"{path}: the network must take float32 image and mask, as inputs (1, 3, H, W) and"
            f" (1, 1, H, W) or as one (1, 4, H, W) (it takes {described}); {_CURE}"
        )
    first_output = tuple(session.outputs[0].shape or ())  # of a list of tensors, it has none
    if len(first_output) != 4 or (isinstance(first_output[1], int) and first_output[1] != 3):
        raise InputError(
            f"{path}: the network's first output must be an image (1, 3, H, W)"
            f" (it is {list(first_output)}); {_CURE}"
        )
    height, width = (
        next((edge for one in shapes.values() if isinstance(edge := one[axis], int)), None)
        for axis in (2, 3)
    )
    return _Inputs(planes, height, width)
