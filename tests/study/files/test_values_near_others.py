"""A value near one of those allowed is refused with that one, wherever values are enumerated."""

import json
from collections.abc import Iterator

import pytest
from command_line import metamerlab

from pipeline.errors import InputError
from pipeline.foveation.conditions import create_condition
from protocols.errors import StudyError, did_you_mean
from protocols.formats.format_reference import schema_text
from protocols.load import load_protocol, shipped


def enumerations(schema: object) -> Iterator[tuple[str, ...]]:
    """Yield every list of words that a schema allows."""
    if isinstance(schema, dict):
        if all(isinstance(one, str) for one in schema.get("enum", [0])):
            yield tuple(schema["enum"])
        for entry in schema.values():
            yield from enumerations(entry)
    elif isinstance(schema, list):
        for entry in schema:
            yield from enumerations(entry)


WORDS = sorted(
    {
        (word, known)
        for known in enumerations(json.loads(schema_text("study")))
        for word in known
        if len(word) > 2
    }
)


@pytest.mark.parametrize(("word", "known"), WORDS)
def test_every_word_of_a_study_is_named_where_it_is_almost_written(word, known):
    spelt = {word.upper(), word.title(), f"{word}s", word.replace("-", "_")} - {*known}
    if sum(other.startswith(word[:-1]) for other in known) == 1:
        spelt.add(word[:-1])
    for found in spelt:
        assert did_you_mean(found, known) == f"; did you mean {word!r}?", found


@pytest.mark.parametrize(
    ("found", "known", "meant"),
    [
        ("centre", ("middle", "top"), "middle"),
        ("Center", ("middle", "top"), "middle"),
        ("center", ("left", "centre"), "centre"),
        ("gray", ("grey", "green"), "grey"),
        ("colour", ("color", "column"), "color"),
        ("off", ("enforce", "none"), "none"),
        ("holm-bonferroni", ("holm", "none"), "holm"),
        ("corr", ("correlated", "independent"), "correlated"),
    ],
)
def test_another_word_for_the_same_is_understood(found, known, meant):
    assert did_you_mean(found, known) == f"; did you mean {meant!r}?"


@pytest.mark.parametrize(
    ("found", "known"), [("", ("middle", "top")), ("zebra", ("middle", "top")), (3, ("3x", "y"))]
)
def test_what_is_near_nothing_gets_no_guess(found, known):
    assert did_you_mean(found, known) == ""


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        ('kind = "foveated-images"\n', 'kind = "foveated-images"\nfit = "cover"\ncrop = "centre"\n',
         "must be 'middle', 'top', 'bottom', 'left' or 'right' or a list (got 'centre');"
         " did you mean 'middle'?"),
        ('mode = "none"', 'mode = "Off"', "(got 'Off'); did you mean 'none'?"),
        ('default_language = "en"', 'default_language = "eng"', "(got 'eng'); did you mean 'en'?"),
    ],
)  # fmt: skip
def test_a_study_is_told_the_value_that_it_means(tmp_path, was, now, said):
    text = shipped("studies")["critical-scaling"].read_text(encoding="utf-8")
    text = text.replace('mode = "enforce"', 'mode = "none"')
    assert was in text
    (tmp_path / "study.toml").write_text(text.replace(was, now), encoding="utf-8")
    with pytest.raises(StudyError) as caught:
        load_protocol(tmp_path / "study.toml")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("given", "meant"),
    [({"law": "Linaer"}, "linear"), ({"residual": "keep"}, "kept"), ({"chroma": "fll"}, "full")],
)
def test_a_parameter_of_a_method_is_told_too(given, meant):
    with pytest.raises(InputError, match=f"did you mean '{meant}'"):
        create_condition("metamer", given)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["doctor", "--for", "Session"], "sessions"),
        (["new-study", "x", "--task", "Rating"], "rating"),
        (["protocol", "schema", "displays"], "display"),
        (["stimuli", "look", "gardn"], "garden"),
        (["figure", "clips", "--score", "shares"], "share"),
        (["protocol", "copy", "Demo", "x.toml"], "demo"),
        (["protocol", "show", "demo", "--script", "--language", "EN"], "en"),
    ],
)
def test_an_option_is_told_too(words, meant):
    done = metamerlab(*words, status=2)
    assert f"did you mean '{meant}'" in " ".join(done.output.replace("│", " ").split())
