"""Files and names alike on Linux, Windows and macOS: folders, line ends, shaders of a session."""

import ast
import re
from pathlib import Path

import pytest

from protocols.disk.whole_file import write_whole
from protocols.errors import StudyError
from study_app.session_folders import require_portable

PACKAGES = ("analysis", "pipeline", "protocols", "stimuli", "study_app")


@pytest.mark.parametrize("code", ["CON", "nul", "Com1", "lpt9", "aux"])
def test_a_code_that_is_a_device_on_windows_is_refused(tmp_path, code):
    with pytest.raises(StudyError, match=r"participant: must not be a name .* a device"):
        require_portable(tmp_path / "study" / code)
    with pytest.raises(StudyError, match=r"study.name: must not be"):
        require_portable(tmp_path / code / "P01")


@pytest.mark.parametrize("code", ["con1", "console", "com", "P01", "lpt10"])
def test_a_code_that_only_begins_like_one_is_taken(tmp_path, code):
    require_portable(tmp_path / "study" / code)


def test_two_codes_that_differ_by_case_alone_are_one_folder_elsewhere(tmp_path):
    (tmp_path / "study" / "P01").mkdir(parents=True)

    require_portable(tmp_path / "study" / "P01")  # said elsewhere: it was used
    with pytest.raises(StudyError, match="must differ by more than case from 'P01'"):
        require_portable(tmp_path / "study" / "p01")


def text_writes(source: str) -> list[int]:
    """Return the lines of calls that leave encoding or line ends to the system."""
    found = []
    for call in (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)):
        name = getattr(call.func, "attr", getattr(call.func, "id", ""))
        given = {keyword.arg for keyword in call.keywords}
        texts = [a.value for a in call.args if isinstance(a, ast.Constant)]
        text_mode = any(re.fullmatch("[wax]t?[+]?", str(text)) for text in texts)
        writes = name == "write_text" and isinstance(call.func, ast.Attribute)
        if (writes or (name in ("open", "fdopen") and text_mode)) and not {
            "encoding", "newline",
        } <= given:  # fmt: skip
            found.append(call.lineno)
        if name == "writer" and "lineterminator" not in given:
            found.append(call.lineno)
    return found


def test_every_text_is_written_with_its_encoding_and_its_line_ends(repository):
    assert text_writes('p.write_text("a", encoding="utf-8")\nopen(p, "w")\ncsv.writer(f)') == [
        1,
        2,
        3,
    ]
    found = [
        f"{path.relative_to(repository)}:{line}"
        for package in PACKAGES
        for path in sorted((repository / package).rglob("*.py"))
        if "node_modules" not in path.parts
        for line in text_writes(path.read_text(encoding="utf-8"))
    ]

    assert not found, "\n".join(found)


def test_every_shader_of_a_session_is_of_opengl_3_3_and_binds_nothing_by_layout(repository):
    shaders = [
        node.value
        for path in sorted((repository / "study_app").rglob("*.py"))
        if "node_modules" not in path.parts
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and "#version" in str(node.value)
    ]

    assert len(shaders) >= 2
    for text in shaders:
        assert text.lstrip().startswith("#version 330"), text[:40]
        assert not re.search(r"layout\s*\(\s*binding", text)


def test_a_file_that_is_written_over_keeps_its_old_content_until_the_new_one_is_whole(tmp_path):
    path = tmp_path / "file.txt"
    path.write_bytes(b"old")
    write_whole(path, b"new\n")

    assert path.read_bytes() == b"new\n"
    assert list(Path(tmp_path).iterdir()) == [path]
