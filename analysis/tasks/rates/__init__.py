"""Analysis that tasks with right answers share: detection, identification, ABX."""

from analysis.tasks.rates.task import RatesTask, rate_parts

__all__ = ["RatesTask", "rate_parts"]
