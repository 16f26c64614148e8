"""Parts of a study of the lab: its recipe, its task, its analysis."""

from typing import ClassVar, Literal

from protocols.phases import Fixation, Image, Phase
from protocols.recipes.base import Recipe, Stimulus
from protocols.tasks.base import Analysis, shown_phase
from protocols.tasks.pairs import PairTask, PreferenceAnalysis
from protocols.units import Degrees, Pixels


class FilledRamps(Recipe):
    """Grey ramps with a hole, whole and filled: ramp `a` rises to the right, `b` downwards."""

    kind: Literal["lab-ramps"]
    fills: dict[str, str]
    """A name in this study, and the fill method it stands for."""
    edge_px: Pixels

    def pool(self):
        return tuple(
            Stimulus(f"{scene}-{name}", {"scene": scene, "method": name})
            for scene in ("a", "b")
            for name in ("whole", *self.fills)
        )

    def described(self, _display, _scenes):
        return (f"Grey ramps of {self.edge_px} px with a hole, filled.",)

    def size_px(self, _display):
        return self.edge_px, self.edge_px

    @property
    def frame_hz(self):
        return 1.0

    @property
    def frames(self):
        return 1


class LabChoice(PreferenceAnalysis):
    """The shipped preferences, told in the lab's words."""

    kind: Literal["lab-choice"]


class Above(PairTask):
    """Fixation, one stimulus above the other, answer."""

    kind: Literal["lab-above"]
    separation_deg: Degrees

    sided = True
    analysis: ClassVar[type[Analysis]] = LabChoice

    def answers(self):
        return "upper", "lower"

    def phases(self, pool, display):
        phase = shown_phase(pool, display, self, "both", [(0, 0.0), (1, 0.0)])
        half_deg = self.separation_deg / 2
        show = (Image(0, 0.0, -half_deg), Image(1, 0.0, half_deg), Fixation())
        return (Phase(phase.name, phase.frames, show, watched=True),)

    def shown_s(self, pool):
        return self.single_s(pool)

    def description(self, pool):
        return f"one above the other for {self.single_s(pool):g} s, answer"
