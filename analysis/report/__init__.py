"""The report: one self-contained HTML file, a JSON of every number, tables and figures."""

from analysis.report.build import ReportPaths, report_decisions, report_sessions

__all__ = ["ReportPaths", "report_decisions", "report_sessions"]
