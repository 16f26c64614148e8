"""Checks that a plan can find anything at all: by a family of tests, over scenes."""

import numpy as np

from analysis.showable import two_scenes
from analysis.tasks import analysis_of
from protocols.study_file.schema import StudyProtocol


def planning_notes(study: StudyProtocol) -> list[str]:
    """Return notes on claims that the planned design can hardly or never show."""
    analysis = study.analysis
    people, families = study.study.participants, analysis_of(analysis.kind).families(study)
    test = getattr(analysis, "test", None)  # of ratings always about further scenes
    alone = ', or say test = "participant", which speaks of these alone' * (test is not None)
    scenes = np.unique([cell.scene for cell in study.task.cells(study.pool)]).size
    return [
        *(note for one in families for note in one.hopeless(people, analysis.alpha)),
        *(
            f"{note}. Show four or more{alone}"
            for note in two_scenes(scenes)
            if test in (None, "participant-scene")
        ),
    ]
