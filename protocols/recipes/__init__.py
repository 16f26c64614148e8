"""Stimulus recipes: `kind` in `[stimuli]` of a study names one of `recipe_kinds.RECIPES`."""
