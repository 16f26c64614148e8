"""Tasks: `kind` in `[task]` of a study names one of `task_kinds.TASKS`."""
