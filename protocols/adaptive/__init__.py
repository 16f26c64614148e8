"""Adaptive trials: which level, or which pairs, come next.

Every function here is pure. It takes the whole history (or the counts of all answers) and the
settings, and keeps no state, so a session that was cut off asks for the same level again
(rule 4 of `docs/architecture.md`).

- `psychometric`: the function from level to probability that all of this shares
- `quest_plus`: the level with the least expected entropy, on a grid of parameters
- `up_down`: weighted and transformed up-down tracks
- `active_pairs`: the most informative pairs of many conditions
- `levels`: what a list of levels and a history of answers must be

numpy and scipy load here and nowhere else in `protocols`, so import the module you need.
"""
