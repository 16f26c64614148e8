"""A statistic with a planned test: on whose side most people are."""

from dataclasses import dataclass

import pandas as pd
from scipy import stats

from analysis.parts import Part, Presentation
from protocols.blocks import Paragraph


@dataclass(frozen=True)
class Sides:
    people: int
    more: int
    p: float
    notes: tuple[str, ...] = ()


class LabSides(Part):
    name = "lab_sides"
    section = ("lab-sides", "Sides")

    def wanted(self, table, plan):
        return "chosen" in table and plan.primary is not None

    def compute(self, table, plan, _found, _chance):
        method, against, _ = plan.primary
        pair = table["chosen"].isin((method, against)) & table["rejected"].isin((method, against))
        rows = table[pair].astype({"participant": str})
        share = (rows["chosen"] == method).groupby(rows["participant"]).mean()
        more, fewer = int((share > 0.5).sum()), int((share < 0.5).sum())
        p = stats.binomtest(more, more + fewer).pvalue if more + fewer else 1.0
        return Sides(more + fewer, more, float(p))

    def planned_p(self, found, _plan):
        return found.p

    def show(self, found, _plan):
        said = f"{found.more} of {found.people} people chose it more often."
        return Presentation(
            blocks=(Paragraph(said),),
            sentences=(said,),
            methods="The lab made a sign test of people.",
            tables={"lab-sides.csv": pd.DataFrame([vars(found)])},
        )
