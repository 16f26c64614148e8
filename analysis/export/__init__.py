"""Exports of recorded studies in the forms that archives and other programs read."""

from analysis.export.choices import FORMATS, ExportOptions
from analysis.export.write import Export, export_study

__all__ = ["FORMATS", "Export", "ExportOptions", "export_study"]
