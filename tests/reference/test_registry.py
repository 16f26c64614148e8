"""Names to classes: which parameters a class has, and what is said of a wrong one."""

import pytest

from pipeline.errors import InputError
from pipeline.named_classes import NamedClass, check_given, defaults_of, find


class Base:
    def __init__(self, *, law: str | None = None, scaling: float | None = None) -> None: ...


class HandsOn(Base):
    def __init__(self, path: str, *, levels: int = 5, **others: object) -> None: ...


class Alone(Base):
    def __init__(self, *, noise: float = 1.0, flat: bool = False) -> None: ...


def test_a_class_that_hands_keywords_on_has_its_bases_parameters():
    assert list(defaults_of(HandsOn)) == ["law", "scaling", "levels"]
    assert defaults_of(HandsOn)["levels"] == 5
    assert list(defaults_of(Alone)) == ["noise", "flat"]


@pytest.mark.parametrize(
    ("kind", "given", "said"),
    [
        (HandsOn, {"lavels": 1}, "did you mean 'levels'"),
        (HandsOn, {"law": 3}, "parameter law must be str"),
        (HandsOn, {"scaling": "wide"}, "parameter scaling must be int or float"),
        (HandsOn, {"scaling": True}, "parameter scaling must be"),
        (HandsOn, {"levels": 2.5}, "parameter levels must be int"),
        (Alone, {"flat": 1}, "parameter flat must be bool"),
        (Alone, {"noise": False}, "parameter noise must be int or float"),
        (Base, {"noise": 1.0}, "parameters of it are: law, scaling"),
    ],
)
def test_a_wrong_parameter_is_named(kind, given, said):
    with pytest.raises(InputError, match=said):
        check_given("it", kind, given)


def test_fitting_parameters_pass():
    check_given("it", HandsOn, {"law": "v1", "scaling": None, "levels": 3})
    check_given("it", Alone, {"noise": 2, "flat": True})


def test_names_are_found_and_paths_follow_a_colon():
    entries = [NamedClass("blur", "", "m:C"), NamedClass("files:", "", "m:C", "FOLDER")]
    assert find(entries, "blur").path_in("blur") == ()
    found = find(entries, "files:a:b")
    assert [str(path) for path in found.path_in("files:a:b")] == ["a:b"]
    with pytest.raises(InputError, match="did you mean 'blur'"):
        find(entries, "Blurr")
    with pytest.raises(InputError, match="must name a path: files:FOLDER"):
        find(entries, "files:")
