"""Coherence transport guided by depth, on the GPU. Twin: reference.py.

After push-pull: gradients; the lists of the first shell and of the known pixels that holes see; the
tensors of these; shell after shell, each over the list that the one before appended; and all put
together.
"""

from itertools import count

import moderngl

from pipeline.frame_textures import FrameTextures
from pipeline.gl.passes import Pass
from pipeline.gl.texture import upload
from pipeline.inpaint.gpu import GuidedBasePass
from pipeline.inpaint.regions import SHELLS
from pipeline.synthesis.settings import MetamericSettings
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
        self._base = self._part(
            GuidedBasePass(
                ctx,
                size,
                gamma=MetamericSettings.gamma,
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
        self._gradients["first"] = first
        self._graded = end[0] - first[0], end[1] - first[1]
        self.attention = None
        if foveated:
            self.attention = self._texture(size, "r32f")
            upload(self.attention, settings.attention(size[::-1]))
            self._finish.hold(attention=self.attention)

    def __call__(self, frame: FrameTextures, *, z_near_m: float) -> None:
        """Fill the holes of `frame.colour` in place; alpha stays as it is.

        Parameters
        ----------
        z_near_m : float
            The clip's nearest depth.
        """
        frame.check(self.size)
        self._base(frame.colour, frame.depth_m, z_near_m)
        self._set(z_near_m=z_near_m)
        self._hold(image=frame.colour, filled=frame.colour, depth_m=frame.depth_m)
        run, holes = self.lists.run, ("holes", 1)
        self._gradients.run_over(self._graded)
        run(self._begin, holes)
        run(self._tensors, ("band", 0))
        for number in count(1):
            slot = (number - 1) % SHELLS
            self._shell["shell"] = float(number)
            self._shell["ways"] = 4 if number % 2 else 8
            self._shell["next_list"] = self.lists.appendable(("shell", slot + 1))
            run(self._shell, ("shell", slot))
            if slot + 1 == SHELLS and not self.lists.carry_shells():
                break
        run(self._finish, holes)
