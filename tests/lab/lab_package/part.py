"""A statistic: how many answers were fast."""

from dataclasses import dataclass

import pandas as pd

from analysis.parts import Part, Presentation
from protocols.blocks import Paragraph


@dataclass(frozen=True)
class Fast:
    share: float
    median_s: float
    notes: tuple[str, ...] = ()


class LabFast(Part):
    name = "lab_fast"
    section = ("lab-fast", "Fast answers")
    needs = ("times",)

    def wanted(self, table, _plan):
        return "rt_s" in table and (table["rt_s"] > 0).any()

    def compute(self, table, _plan, found, _chance):
        return Fast(float((table["rt_s"] < 0.5).mean()), found["times"].summary[0].median)

    def show(self, found, _plan):
        said = f"{100 * found.share:.0f} % of answers came within 0.5 s."
        return Presentation(
            blocks=(Paragraph(said),),
            sentences=(said,),
            methods="The lab counted answers within 0.5 s.",
            tables={"lab-fast.csv": pd.DataFrame([vars(found)])},
        )
