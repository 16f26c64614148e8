"""Coherence transport guided by depth, on the GPU. Twin: reference.py.

After push-pull: gradients; the lists of the first shell and of the known pixels that holes see; the
tensors of these; shell after shell, each over the list that the one before appended; and all put
together. Then, where detail is asked for, the gate, and `metameric`'s own passes over the result.
"""

import moderngl

from pipeline.frame_textures import FrameTextures
from pipeline.gl.passes import Pass
from pipeline.gl.texture import upload
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.inpaint.regions import CELL, FIRST_STORED, SHELLS
from pipeline.synthesis.gpu import MetamericPass
from pipeline.transport import reference as fixed
from pipeline.transport.reference import TransportSettings

ROW = 64  # work-group size, pixels in a row


class TransportPass(Pass):
    """Fill the holes of one frame's colour, in place. Known pixels keep their bits.

    A call allocates nothing. It reads back a few numbers for every `SHELLS` shells.

    Parameters
    ----------
    size : (width, height)
        Any from 1x1.
    """

    def __init__(
        self, ctx: moderngl.Context, size: tuple[int, int], settings: TransportSettings
    ) -> None:
        super().__init__(ctx, {**vars(fixed), "ROW": ROW})
        self.size = size
        self.settings = settings
        noise = settings.noise
        self._base = self._part(
            GuidedBasePass(
                ctx,
                size,
                gamma=noise.gamma,
                levels=noise.levels if noise.noise else 1,
                depth_threshold=settings.depth_threshold,
                shells=True,
            )
        )
        self.lists = self._base.lists
        foveated = settings.fovea_deg > 0
        self._gradients, self._begin, self._tensors, self._shell = (
            self._shader(f"transport/{name}.comp.glsl")
            for name in ("gradients", "begin", "tensors", "shell")
        )
        self._finish = self._shader("transport/finish.comp.glsl", FOVEATED=foveated)
        self._gate = None
        if noise.noise:
            self._gate = self._shader("transport/gate.comp.glsl", TILE=CELL // 2)
        self._begin["shell_list"] = self.lists.appendable(("shell", 0))
        self._begin["band_list"] = self.lists.appendable(("band", 0))
        self._set(depth_threshold=settings.depth_threshold, share=settings.share)
        self.moved, self.tensors, gradients = (self._texture(size, "rgba32f") for _ in range(3))
        self.listed = self._buffer(bytes(4 * size[0] * size[1]))
        self._hold(
            **self.lists.shared,
            moved=self.moved,
            tensors=self.tensors,
            gradients=gradients,
            listed=self.listed,
        )
        rows, columns = settings.worked(size[::-1])
        self._set(low=(columns.start, rows.start), high=(columns.stop, rows.stop))
        reach = fixed.RADIUS_PX + fixed.TENSOR_REACH_PX + 1
        first = max(0, columns.start - reach), max(0, rows.start - reach)
        end = min(size[0], columns.stop + reach), min(size[1], rows.stop + reach)
        if noise.noise:
            first, end = (0, 0), size
        self._gradients["first"] = first
        self._graded = end[0] - first[0], end[1] - first[1]
        self.attention = None
        if foveated:
            self.attention = self._texture(size, "r32f")
            upload(self.attention, settings.attention(size[::-1]))
            self._finish.hold(attention=self.attention)
        if self._gate is not None:
            gate = self._texture(self._base.resolutions.sizes[fixed.GATE_LOG2], "r32f")
            self._gate.hold(gate=gate)
            self.detail = self._part(
                MetamericPass(
                    ctx, size, noise, base=self._base, gate=gate, attention=self.attention
                )
            )

    def __call__(self, frame: FrameTextures, *, z_near_m: float, seed: int = 0) -> None:
        """Fill the holes of `frame.colour` in place; alpha stays as it is.

        Parameters
        ----------
        z_near_m : float
            The clip's nearest depth.
        seed : int
            Of the detail's noise.
        """
        if self._gate is not None:
            self.detail.set_seed(seed)
        self.tell(z_near_m=z_near_m)
        self._play(self._prepare, frame)
        first = 1
        while self.lists.carry_shells():
            first += SHELLS
            self._play(self._walk, frame, first)
        self._play(self._end, frame)

    def _prepare(self, frame: FrameTextures) -> None:
        frame.check(self.size)
        self._base.fill(frame.colour, frame.depth_m)
        self._show(frame)
        self._gradients.run_over(self._graded)
        self.lists.run(self._begin, ("holes", 1))
        self.lists.run(self._tensors, ("band", 0))
        self._walk(frame, 1)

    def _walk(self, frame: FrameTextures, first: int) -> None:
        """Fill so many shells, from the `first` on."""
        self._show(frame)
        for slot in range(SHELLS):
            self._shell["shell"] = float(first + slot)
            self._shell["ways"] = 8 if slot % 2 else 4
            self._shell["next_list"] = self.lists.appendable(("shell", slot + 1))
            self.lists.run(self._shell, ("shell", slot))

    def _end(self, frame: FrameTextures) -> None:
        self._show(frame)
        self.lists.run(self._finish, ("holes", 1))
        if self._gate is not None:
            self.lists.run(self._gate, ("first", 1), 1 + FIRST_STORED)
            self.detail.fill(frame)

    def _show(self, frame: FrameTextures) -> None:
        self._hold(image=frame.colour, filled=frame.colour, depth_m=frame.depth_m)
