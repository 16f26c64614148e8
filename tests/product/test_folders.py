"""The table of folders in docs/architecture.md is what the packages say of themselves."""

import pytest
from folders import HEAD, PAGE, folder_table, package_files, with_table


def test_the_table_of_folders_is_made_of_the_packages_docstrings(repository):
    files, page = package_files(repository), (repository / PAGE).read_text(encoding="utf-8")
    assert len(files) > 50

    told = "; run script/site/folders.py"
    assert with_table(page, folder_table(repository, files)) == page, f"{PAGE} is old{told}"


def test_a_folder_is_told_by_its_first_sentence_alone(tmp_path):
    (tmp_path / "__init__.py").write_text(
        '"""Push-pull (Gortler et al. 1996): it fills,\nand blurs. It is\nthe rival."""\n'
    )
    line = "| `` | Push-pull (Gortler et al. 1996): it fills, and blurs |\n"

    assert folder_table(tmp_path, ["__init__.py"]) == HEAD + line
    assert with_table(f"before\n{HEAD}old\n\nafter", HEAD + line) == f"before\n{HEAD}{line}\nafter"


def test_a_folder_that_says_nothing_is_named(tmp_path):
    (tmp_path / "__init__.py").write_text("")
    with pytest.raises(ValueError, match=r"__init__.py: must say in a sentence what lies there"):
        folder_table(tmp_path, ["__init__.py"])
