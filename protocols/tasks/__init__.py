"""Tasks: `kind` in `[task]` of a study names one of `registry.TASKS`."""
