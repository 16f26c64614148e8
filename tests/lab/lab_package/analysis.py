"""An analysis: the numbers of the shipped one, a section of its own."""

from dataclasses import replace

from analysis.parts.preferences import PreferencesPart
from analysis.parts.times import TimesPart
from analysis.tasks.preference import PreferenceOfPairs
from protocols.blocks import Paragraph


class LabPreferences(PreferencesPart):
    section = ("lab", "The lab's section")

    def show(self, found, plan):
        shown = super().show(found, plan)
        said = f"The lab found: {shown.headline}"
        return replace(shown, headline=said, blocks=(Paragraph(said),), further=(), figures=())


class LabAnalysis(PreferenceOfPairs):
    kind = "lab-choice"
    parts = (LabPreferences(), TimesPart())
