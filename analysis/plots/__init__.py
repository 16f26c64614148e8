"""Figures of results: legible at one column (3.33 in) and two (7 in), saved reproducibly."""

from analysis.plots.curves import learning_plot, power_plot
from analysis.plots.preference_plots import jod_plot, preference_bars
from analysis.plots.psychometric_plots import DrawnCurve, people_plot, psychometric_plot
from analysis.plots.style import ONE_COLUMN_IN, TWO_COLUMNS_IN, figure_bytes, save_figure
from analysis.plots.tasks import d_prime_plot, detection_plot, rates_plot, scaling_plot
from analysis.plots.trial_plots import bias_bars, heat_map, reaction_plot

__all__ = [
    "ONE_COLUMN_IN",
    "TWO_COLUMNS_IN",
    "DrawnCurve",
    "bias_bars",
    "d_prime_plot",
    "detection_plot",
    "figure_bytes",
    "heat_map",
    "jod_plot",
    "learning_plot",
    "people_plot",
    "power_plot",
    "preference_bars",
    "psychometric_plot",
    "rates_plot",
    "reaction_plot",
    "save_figure",
    "scaling_plot",
]
