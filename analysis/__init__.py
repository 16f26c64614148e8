"""Statistics, plots and a report from session journals.

`arrays` names types of arrays, as `pipeline.frame` does for the pipeline. `power` is the one
simulator of power; `answers` and `simulations` draw the answers of each kind of task, and `pilot`
takes deviations from a pilot.
"""

SEED = 20_240_229
"""Every random draw of an analysis starts here: same journals, same numbers."""
