"""An analysis: the numbers of the shipped one, a page of its own."""

from analysis.report.blocks import Paragraph, Section
from analysis.tasks.preference import PreferenceOfPairs


class LabAnalysis(PreferenceOfPairs):
    kind = "lab-choice"

    def sections(self, results, settings):
        said = Paragraph(self.headline(results, settings))
        return [Section("lab", "Lab", "The lab's section", (said,))]

    def figures(self, _decisions, _results, _settings, *, simulated):  # noqa: ARG002
        return []

    def headline(self, results, settings):
        return "The lab found: " + super().headline(results, settings)
