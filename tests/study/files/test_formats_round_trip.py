"""Every format survives writing and reading; the published schemas agree with the models."""

import json
import os
import tomllib
import types
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
import jsonschema
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, StringConstraints, TypeAdapter
from pydantic.fields import FieldInfo

from protocols import journal
from protocols.disk.hashing import canonical_json, sha256_bytes, sha256_file, sha256_json
from protocols.display import Display
from protocols.errors import StudyError
from protocols.feasibility import virtual_manifest
from protocols.formats.format_reference import (
    json_schema,
    reference_text,
    schema_names,
    schema_path,
    schema_text,
)
from protocols.journal import EVENT, Attempt, event_line
from protocols.journal_file import read_journal
from protocols.load import load_display, load_protocol, shipped
from protocols.manifest import Clip, Manifest, cache_key, frame_path, read_manifest, write_manifest
from protocols.recipes.files import Files
from protocols.recipes.warped_clips import ClipName
from protocols.study_file.schema import StudyProtocol
from protocols.study_file.session_schema import Design, Gaze, Practice, Response, TrialTiming
from protocols.tasks.task_kinds import TASKS

EVENTS = get_args(get_args(journal.AnyEvent)[0])


def values(annotation: Any, metadata: list[Any]) -> st.SearchStrategy[Any]:
    """A strategy for a type of our models, read from the same annotations as the loader reads."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        extra = [
            part
            for entry in arguments[1:]
            for part in (entry.metadata if isinstance(entry, FieldInfo) else [entry])
        ]
        return values(arguments[0], [*extra, *metadata])
    if origin in (Union, types.UnionType):
        return st.one_of([values(part, metadata) for part in arguments])
    if origin is Literal:
        return st.sampled_from(arguments)
    if origin is tuple:
        least = next((m.min_length for m in metadata if hasattr(m, "min_length")), 0)
        if arguments[-1] is Ellipsis:
            items = st.lists(values(arguments[0], []), min_size=least, max_size=least + 2)
            return items.map(tuple)
        return st.tuples(*(values(part, []) for part in arguments))
    if origin is dict:
        keys, entries = values(arguments[0], []), values(arguments[1], [])
        return st.dictionaries(keys, entries, min_size=1, max_size=2)
    if annotation in (int, float):
        return _numbers(annotation, metadata)
    if annotation is str:
        pattern = next(
            (m.pattern for m in metadata if isinstance(m, StringConstraints) and m.pattern), None
        )
        if pattern:
            longest = min(
                [m.max_length for m in metadata if getattr(m, "max_length", None)], default=100
            )
            texts = st.from_regex(pattern, fullmatch=True)
            return texts.filter(lambda text: len(text) <= longest and text.isascii())
        # Control characters are refused wherever text comes from outside.
        return st.text(st.characters(exclude_categories=["Cc", "Cs"]), min_size=1, max_size=20)
    if annotation is bool:
        return st.booleans()
    if annotation is type(None):
        return st.none()
    return instances(annotation)


def _numbers(annotation: type, metadata: list[Any]) -> st.SearchStrategy[Any]:
    low, high, open_low, open_high = None, None, False, False
    for entry in metadata:
        if isinstance(entry, annotated_types.Gt):
            low, open_low = entry.gt, True
        elif isinstance(entry, annotated_types.Ge):
            low = entry.ge
        elif isinstance(entry, annotated_types.Lt):
            high, open_high = entry.lt, True
        elif isinstance(entry, annotated_types.Le):
            high = entry.le
    high = 2**53 if high is None else high  # `units.storable`: what tables hold exactly
    low = -(2**53) if low is None and annotation is float else low
    if annotation is int:
        return st.integers((low + open_low) if low is not None else None, high)
    return st.floats(
        low, high, exclude_min=open_low, exclude_max=open_high, allow_nan=False,
        allow_infinity=False,
    )  # fmt: skip


def instances(model: type[BaseModel]) -> st.SearchStrategy[Any]:
    """A strategy for a model; combinations that its validators refuse are drawn again."""
    fields = {
        name: values(f.annotation, list(f.metadata)) for name, f in model.model_fields.items()
    }

    def build(drawn: dict[str, Any]) -> BaseModel | None:
        try:
            return model(**drawn)
        except ValueError:
            return None

    return st.fixed_dictionaries(fields).map(build).filter(lambda made: made is not None)


def attempts() -> st.SearchStrategy[Attempt]:
    """Attempts whose outcome fits their answer."""
    fields = {
        name: values(f.annotation, list(f.metadata)) for name, f in Attempt.model_fields.items()
    }

    def build(drawn: dict[str, Any]) -> Attempt:
        answers = tuple(dict.fromkeys(drawn["answers"])) or ("yes", "no")
        expected = drawn["expected"] and answers[0]
        drawn |= {"answers": answers, "expected": expected}
        if drawn["outcome"] == "void":
            drawn |= dict.fromkeys(("answer", "correct", "rt_s")) | {"further": ()}
            drawn["void_reason"] = drawn["void_reason"] or "quit"
        else:
            answer = answers[-1] if drawn["warned"] else answers[0]
            drawn |= {
                "void_reason": None,
                "answer": answer,
                "correct": answer == expected if expected else None,
                "rt_s": drawn["rt_s"] or 0.0,
            }
        return Attempt(**drawn)

    return st.fixed_dictionaries(fields).map(build)


@pytest.mark.parametrize("event_class", EVENTS, ids=lambda entry: entry.__name__)
def test_every_event_survives_its_journal_line(event_class):
    strategy = attempts() if event_class is Attempt else instances(event_class)

    @settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def survives(event):
        line = event_line(event)
        assert line.count(b"\n") == 1
        assert line.endswith(b"\n")
        assert EVENT.validate_json(line, strict=True) == event
        assert event_line(EVENT.validate_json(line, strict=True)) == line

    survives()


@pytest.mark.slow
@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(instances(Clip), max_size=3, unique_by=lambda c: c.name), st.data())
def test_a_manifest_survives_its_file(tmp_path, clips, data):
    fields = Manifest.model_fields
    drawn = {
        name: data.draw(values(field.annotation, list(field.metadata)))
        for name, field in fields.items()
        if name != "clips"
    }
    manifest = Manifest(**(drawn | {"format": 2}), clips=tuple(clips))

    path = write_manifest(tmp_path, manifest)

    assert read_manifest(tmp_path) == manifest
    assert manifest.sha256 == sha256_file(path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["manifest.json"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"format": 1, "study"', "must be the manifest of a build (its reader says: Expecting"),
        (b"\xff\xfe", "line 1: must be UTF-8 text (got byte 0xff)"),
        (b'{"format": 3}', "format: must be 2 (got 3)"),
        (b'{"format": 2}', "clips: missing"),
        (b'{"format": 2, "clips": [{"name": 3}]}', "clips[0].name: must be text in quotes (got 3)"),
    ],
)
def test_a_manifest_that_is_none_is_told(tmp_path, content, message):
    path = tmp_path / "manifest.json"
    path.write_bytes(content)

    with pytest.raises(StudyError) as caught:
        read_manifest(tmp_path)

    assert message in str(caught.value)
    assert all(line.startswith(f"{path}: ") for line in str(caught.value).splitlines())


def test_a_manifest_is_written_whole_or_not_at_all(tmp_path, sample_manifest, monkeypatch):
    write_manifest(tmp_path, sample_manifest)
    before = (tmp_path / "manifest.json").read_bytes()

    def full(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StudyError, match=r"must be writable \(No space left on device\)"):
        write_manifest(tmp_path, sample_manifest.model_copy(update={"revision": "other"}))
    monkeypatch.undo()

    assert [entry.name for entry in tmp_path.iterdir()] == ["manifest.json"]
    assert (tmp_path / "manifest.json").read_bytes() == before


def test_what_is_no_folder_of_clips_is_named_with_what_to_name_in_its_place(
    tmp_path, sample_manifest
):
    (tmp_path / "study" / "clips").mkdir(parents=True)
    write_manifest(tmp_path / "study" / "clips", sample_manifest)
    (tmp_path / "study" / "study.toml").touch()
    none, study, clips = tmp_path / "none", tmp_path / "study", tmp_path / "study" / "clips"
    for folder, found, cure in (
        (none, "no such folder", f"run 'metamerlab stimuli build STUDY --out {none}' to the end"),
        (tmp_path, "no manifest.json", f"stimuli build STUDY --out {tmp_path}' to the end"),
        (study, "no manifest.json", f"name {clips}"),
        (clips / "manifest.json", "this is a file", f"name {clips}"),
        (study / "study.toml", "this is a file", "name the folder that 'metamerlab stimuli build'"),
    ):
        with pytest.raises(StudyError) as caught:
            read_manifest(folder)
        assert f"{folder}: must hold a finished batch of clips" in str(caught.value)
        assert found in str(caught.value)
        assert cure in str(caught.value)


@pytest.fixture
def sample_manifest():
    protocol = load_protocol(Path("demo"))
    return virtual_manifest(protocol, load_display(protocol.display.display))


def test_a_copy_of_a_manifest_finds_its_own_clips_and_hash(sample_manifest):
    first, *others = sample_manifest.clips
    assert sample_manifest.clip(first.name) is first
    before = sample_manifest.sha256
    copy = sample_manifest.model_copy(update={"clips": (*others, first)})

    assert copy.clip(others[0].name) is others[0]
    assert copy.sha256 != before == sample_manifest.sha256
    fewer = sample_manifest.model_copy(update={"clips": tuple(others)})
    with pytest.raises(KeyError, match=first.name):
        fewer.clip(first.name)
    assert sample_manifest == sample_manifest.model_copy()


def test_two_clips_of_one_name_are_refused(sample_manifest):
    plain = sample_manifest.model_dump()
    plain["clips"] = (plain["clips"][0], plain["clips"][0])

    with pytest.raises(ValueError, match=r"differ in name \(got garden__small__reference 2 times"):
        Manifest.model_validate(plain)


SECTIONS = [
    Design,
    TrialTiming,
    Gaze,
    Response,
    Practice,
    Files,
    *(kind.task for kind in TASKS.values()),
]
SECTIONS += dict.fromkeys(kind.task.analysis for kind in TASKS.values())


@pytest.mark.parametrize("model", SECTIONS, ids=lambda entry: entry.__name__)
def test_sections_survive_plain_data(model):
    @settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
    @given(instances(model))
    def survives(made):
        assert TypeAdapter(model).validate_json(canonical_json(made)) == made

    survives()


@pytest.mark.parametrize("name", sorted(shipped("studies")))
def test_shipped_studies_survive_json_and_fit_the_published_schema(name):
    protocol = load_protocol(shipped("studies")[name])
    plain = json.loads(canonical_json(protocol))

    assert StudyProtocol.model_validate_json(canonical_json(protocol)) == protocol
    jsonschema.Draft202012Validator(json_schema("study")).validate(plain)
    load_display(protocol.display.display)


@pytest.mark.parametrize("name", sorted(shipped("displays")))
def test_shipped_displays_are_named_as_their_files(name):
    display = load_display(name)

    assert display.name == name
    jsonschema.Draft202012Validator(json_schema("display")).validate(
        json.loads(canonical_json(display))
    )


@pytest.mark.parametrize("folder", ["studies", "displays"])
def test_shipped_files_fit_the_schema_that_their_first_line_names(folder):
    """Editors complete and check a TOML file by that line."""
    for path in shipped(folder).values():
        text = path.read_text(encoding="utf-8")
        pointer = text.splitlines()[0].removeprefix("#:schema ")
        schema = json.loads((path.parent / pointer).read_text(encoding="utf-8"))
        jsonschema.Draft202012Validator(schema).validate(tomllib.loads(text))


@pytest.mark.parametrize("name", schema_names())
def test_the_published_schema_is_in_step_with_the_model(name):
    jsonschema.Draft202012Validator.check_schema(json_schema(name))
    assert schema_path(name).read_text(encoding="utf-8") == schema_text(name), (
        "run 'metamerlab protocol schema --write' and commit protocols/schemas"
    )


@pytest.mark.parametrize("model", [*EVENTS, Display, Clip], ids=lambda entry: entry.__name__)
def test_the_published_schema_documents_every_class(model):
    assert model.__doc__
    assert model.__doc__ != BaseModel.__doc__


def test_canonical_json_is_the_same_for_the_same_content():
    assert canonical_json({"b": 1, "a": [0.1, "ä", None]}) == '{"a":[0.1,"ä",null],"b":1}'.encode()
    assert sha256_json({"a": 1, "b": 2}) == sha256_json({"b": 2, "a": 1})
    assert sha256_bytes(b"abc").startswith("ba7816bf8f01cfea414140de5dae2223b00361a3")
    with pytest.raises(ValueError, match="JSON compliant"):
        canonical_json({"a": float("nan")})


def test_clip_names_are_unambiguous_and_frames_are_numbered():
    name = ClipName("garden", "small", "push-pull")

    assert str(name) == "garden__small__push-pull"
    assert frame_path(name, 12) == "garden__small__push-pull/000012.png"
    assert cache_key({"scene": "garden"}) != cache_key({"scene": "shed"})


def test_stimuli_hash_ignores_wording_and_timing_but_not_pixels():
    protocol = load_protocol(Path("demo"))
    other_gap = protocol.model_copy(
        update={"task": protocol.task.model_copy(update={"gap_s": 1.0})}
    )
    clips = protocol.warped.clips.model_copy(update={"width_deg": 9.0})
    wider = protocol.model_copy(
        update={"stimuli": protocol.warped.model_copy(update={"clips": clips})}
    )

    assert other_gap.stimuli_sha256 == protocol.stimuli_sha256
    assert other_gap.sha256 != protocol.sha256
    assert wider.stimuli_sha256 != protocol.stimuli_sha256


def test_a_journal_reads_back_and_a_torn_last_line_is_told_apart(tmp_path):
    note = journal.Note(n=0, t_s=0.0, at="2026-01-01T00:00:00Z", text="first\nline")
    later = note.model_copy(update={"n": 1})
    path = tmp_path / "journal.jsonl"
    lines = event_line(note) + event_line(later)

    for length in range(len(event_line(note)), len(lines) + 1):
        path.write_bytes(lines[:length])
        read = read_journal(path)
        whole = length >= len(lines) - 1  # only the line feed may be missing
        assert read.events == ((note, later) if whole else (note,))
        assert read.torn == (b"" if whole else lines[len(event_line(note)) : length])
        assert read.ends_open == (length == len(lines) - 1)


@pytest.mark.parametrize("name", schema_names())
def test_every_key_of_every_class_is_in_its_section_of_the_reference(name):
    schema = json_schema(name)
    sections = {
        heading: body
        for heading, _, body in (
            part.partition("\n") for part in reference_text(name).split("\n## ")[1:]
        )
    }

    classes = {**schema.get("$defs", {}), schema["title"]: schema}
    missing = [
        f"{title}.{key}"
        for title, definition in classes.items()
        for key in definition.get("properties", {})
        if f"`{key}`" not in sections[title]
    ]
    assert missing == []
    assert any("properties" in definition for definition in classes.values())


@pytest.mark.parametrize("name", schema_names())
def test_the_reference_in_the_docs_is_in_step_with_the_model(name, repository):
    page = repository / "docs" / "formats" / f"{name}.md"

    assert page.read_text(encoding="utf-8") == reference_text(name), (
        f"run 'metamerlab protocol schema {name} --markdown > docs/formats/{name}.md'"
    )
