"""One way to read what people write: marks, UTF-16 and line ends of Windows change nothing."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.pictures.warp_input import read_pose
from protocols.errors import StudyError
from protocols.load import read_toml
from protocols.recipes.files import read_table
from stimuli.score.viewing_conditions import read_viewer_gaze
from study_app.gaze.recording import load_recording

GAZE = "t_s,x_px,y_px\n0,10.5,20\n0.01,11.5,21\n0.02,12.5,22\n"
POSES = "# stamp tx ty tz qx qy qz qw\n0.5 1 2.25 3 0 0 0 1\n1.0 4 5 6 0 0 1 0\n"
READERS = {
    "a study": (read_toml, "study.toml", '[study]\ntitle = "Détails"\nname = "a"\n'),
    "stimuli": (read_table, "stimuli.csv", "stimulus,file,ort\na,a.png,Zürich\nb,b.png,Łódź\n"),
    "poses": (lambda path: read_pose(f"{path}:2").tolist(), "poses.txt", POSES),
    "gaze": (lambda path: load_recording(path).x_px.tolist(), "gaze.csv", GAZE),
    "gaze of a viewer": (lambda path: read_viewer_gaze(str(path)), "points.csv", GAZE),
}
CODES = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be")


@pytest.mark.parametrize("what", READERS)
def test_encodings_and_line_ends_change_nothing(what, tmp_path):
    read, name, text = READERS[what]
    path = tmp_path / name

    def found(code: str, end: str) -> object:
        path.write_bytes(text.replace("\n", end).encode(code))
        return read(path)

    plain = found("utf-8", "\n")
    assert [found(code, end) == plain for code in CODES for end in ("\n", "\r\n")] == [True] * 10


@pytest.mark.parametrize("what", ["poses", "gaze", "gaze of a viewer"])
def test_semicolons_come_with_decimal_commas(what, tmp_path):
    read, name, text = READERS[what]
    path = tmp_path / name
    path.write_text(text)
    plain = read(path)
    separator = " " if what == "poses" else ","
    path.write_text(text.replace(separator, ";").replace(".", ","))

    assert read(path) == plain


def test_by_hand(tmp_path: Path):
    path = tmp_path / "poses.txt"
    path.write_text("0,5;1;2,25;3;0;0;0;1\n")
    np.testing.assert_array_equal(read_pose(f"{path}:1")[:3, 3], [1.0, 2.25, 3.0])


@pytest.mark.parametrize("what", ["a study", "stimuli"])
def test_no_other_encoding_is_guessed_where_names_must_match(what, tmp_path):
    read, name, text = READERS[what]
    path = tmp_path / name
    path.write_bytes(text.replace("Łódź", "Genève").encode("cp1252"))
    with pytest.raises(StudyError, match=r"must be UTF-8 text.*save the file as UTF-8"):
        read(path)


@pytest.mark.parametrize("what", ["gaze", "gaze of a viewer"])
def test_a_comma_in_a_cell_beside_commas_is_no_decimal_one(what, tmp_path):
    read, name, text = READERS[what]
    path = tmp_path / name
    path.write_text(text.replace("10.5", '"1,043"'))
    with pytest.raises(StudyError, match="line 2"):
        read(path)
