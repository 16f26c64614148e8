"""The table that the program pwcmp reads, and `metamerlab analysis import` as well."""

from pathlib import Path

from analysis.export.export_content import ExportedStudy
from analysis.tables.write_table import write_table
from analysis.tidy import pwcmp_table
from protocols.outside import page_bytes

NAME = "pwcmp.csv"


def write_pwcmp(content: ExportedStudy, folder: Path) -> tuple[str, ...]:
    """Write the decisions that the protocol's rules keep, and a README."""
    table = pwcmp_table(content.tables.analysed)
    write_table(table, folder / NAME)
    first = "comes first in the alphabet" if content.left_out else "was shown first"
    text = content.readme(
        f"`{NAME}`: one decision per row, main trials that the protocol's exclusion rules keep."
        " `observer` and `session` name the participant; `scene` is scene and amount of"
        " disocclusion, since only clips of one amount were compared; `condition_A`"
        f" {first}; `is_A_selected` is 1 where it was preferred. `scene_name` and `size` are scene"
        " and amount apart; pwcmp passes over them, and `analysis import --map scene=scene_name`"
        " takes them.",
        lists_sessions=False,
    )
    (folder / "README.md").write_bytes(page_bytes(text))
    return ()
