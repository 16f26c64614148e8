"""The site: every page is in it, every link leads somewhere, nothing is fetched from outside."""

import importlib
import json
import re
import shlex
import subprocess
import sys
import tomllib
import zlib
from base64 import b64decode
from pathlib import Path

import pages
import pictures
import pytest
from command_line import metamerlab

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).resolve().parents[1]
SOURCES = [
    *(REPOSITORY / f"{name}.md" for name in ("CHANGELOG", "CONTRIBUTING")),
    *sorted([*REPOSITORY.glob("docs/**/*.md"), *REPOSITORY.glob("benchmarks/results/*.md")]),
]
OURS = ("analysis", "pipeline", "protocols", "stimuli", "study_app")
# What a browser fetches to show a page; where a link leads is the reader's to follow.
FETCHED = re.compile(
    r"""<(?:script|img|source|iframe|video)\b[^>]*?\bsrc="([^"]+)"|<link\b[^>]*?\bhref="([^"]+)"|"""
    r"""url\(\s*['"]?([^'")]+)|@import\s+['"]([^'"]+)"""
)


def from_outside(text: str) -> list[str]:
    """Return the addresses on other hosts that showing a page or style would fetch."""
    found = ["".join(groups) for groups in FETCHED.findall(text)]
    return [address for address in found if re.match(r"(?:https?:)?//", address)]


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    pytest.importorskip("sphinx", reason="needs the extra `docs`: script/docs installs it")
    out = tmp_path_factory.mktemp("site") / "site"
    done = subprocess.run(
        [sys.executable, REPOSITORY / "script/site/build.py", "--out", out],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return out


def test_the_site_is_whole_and_holds_every_page(site):
    """Sphinx warns of a page that no section lists, and a warning ends the build."""
    for path in SOURCES:
        name = path.relative_to(REPOSITORY).with_suffix(".html")
        assert (site / name).is_file(), name
    assert "<h1>metamerlab" in (site / "index.html").read_text(encoding="utf-8")
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    assert "metameric_fill" in index


def test_nothing_is_fetched_from_another_host(site):
    found = {
        f"{path.relative_to(site)}: {address}"
        for path in site.rglob("*")
        if path.suffix in {".html", ".css"}
        for address in from_outside(path.read_text(encoding="utf-8"))
    }

    assert found == set()


def test_the_search_for_other_hosts_finds_them():
    text = (
        '<a href="https://a.org">b</a><img alt="" src="https://c.org/d.png"><link rel="x" '
        'href="//e.org/f.css"><img src="g.png"> @import "http://h.org"; src: url(https://i.org/j)'
    )

    assert from_outside(text) == [
        "https://c.org/d.png", "//e.org/f.css", "http://h.org", "https://i.org/j",
    ]  # fmt: skip


def test_every_call_that_a_page_imports_is_in_the_reference():
    listed = [
        getattr(importlib.import_module(module), name)
        for stage in pages.site()["api"]
        for module, names in stage["modules"].items()
        for name in names
    ]

    imported = set()
    for path in (REPOSITORY / "README.md", *SOURCES):
        for block in re.findall(r"^```python\n(.*?)^```", path.read_text("utf-8"), re.M | re.S):
            for module, names in re.findall(r"^from ([\w.]+) import ([\w, ]+)$", block, re.M):
                if module.partition(".")[0] in OURS and module != "protocols.units":
                    imported |= {(module, name) for name in names.split(", ")}
    assert len(imported) > 10
    missing = {
        f"{module}.{name}"
        for module, name in imported
        if not any(getattr(importlib.import_module(module), name) is each for each in listed)
    }
    assert missing == set()


def test_every_public_call_says_what_it_does():
    bare = [
        f"{module}.{name}"
        for stage in pages.site()["api"]
        for module, names in stage["modules"].items()
        for name in names
        if not getattr(importlib.import_module(module), name).__doc__
    ]

    assert bare == []


def test_pictures_are_small_and_each_is_shown():
    shown = {
        pictures.MADE / name
        for path in (REPOSITORY / "README.md", *SOURCES)
        for name in re.findall(r"images/made/([\w.-]+)\)", path.read_text("utf-8"))
    }

    assert shown == set(pictures.MADE.iterdir())
    sizes = {path: path.stat().st_size for path in shown if path.suffix != ".html"}
    assert max(sizes.values()) <= pictures.LARGEST_BYTES
    assert sum(sizes.values()) <= 1_500_000
    (page,) = shown - set(sizes)
    assert page.stat().st_size <= pictures.LARGEST_PAGE_BYTES


def test_every_made_picture_has_commands_that_make_it():
    makers = {p for page in pictures.pages() for p in pictures.pictures_of(page)}

    assert set(pictures.MADE.iterdir()) <= makers


GROUPS = {"protocol", "stimuli", "session", "analysis", "texture", "denoise"}


def options_of(words: list[str]) -> set[str]:
    """Return the options that the help of a command of `metamerlab` lists."""
    command = words[: 2 if words[0] in GROUPS else 1]
    done = metamerlab(*command, "--help", env={"COLUMNS": "200", "TERM": "dumb"})
    return set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", done.output))


@pytest.mark.parametrize("name", ["gallery", "figures/metameric-inpainting", "figures/beyond-blur"])
def test_the_commands_below_pictures_exist_and_know_their_options(name):
    text = (REPOSITORY / f"docs/{name}.md").read_text(encoding="utf-8")
    blocks = "".join(re.findall(r"^```(?:bash|console)\n(.*?)^```", text, re.M | re.S))
    lines = [line.removeprefix("$ ") for line in blocks.replace("\\\n", " ").splitlines()]
    commands = [shlex.split(line)[1:] for line in lines if line.startswith("metamerlab")]

    assert len(commands) >= 8
    for words in commands:
        given = {word for word in words if re.match(r"--?[a-z]", word)}
        assert given <= options_of(words), words


@pytest.mark.full
@pytest.mark.usefixtures("shared_gl_context")
def test_the_gallerys_commands_make_its_pictures(tmp_path):
    page = REPOSITORY / "docs/gallery.md"

    done = pictures.run(page, tmp_path)

    assert done.returncode == 0, f"{done.stdout}{done.stderr}"
    for picture in pictures.pictures_of(page):
        assert pictures.written(picture, tmp_path).is_file()


def parts_of(page):
    """Return the words of a page, without pixels, and of its programs; both without comments."""
    text = page.read_text(encoding="utf-8")
    first = re.search(r'class="part">([^<]+)<', text)[1]
    told = json.dumps(json.loads(zlib.decompress(b64decode(first))), indent=0).replace("\\n", "\n")
    text = re.sub(r'class="part">[^<]+<', "", text)
    return [re.sub(r"//.*|/\*.*?\*/", "", one).split() for one in (text, told)]


def test_the_page_that_follows_the_mouse_is_what_its_command_makes(tmp_path):
    page = REPOSITORY / "docs/gallery.md"
    made, kept = tmp_path / "follow.html", pictures.MADE / "follow.html"
    assert kept in pictures.pictures_of(page)
    (command,) = [
        shlex.split(line) for line in pictures.script_of(page).replace("\\\n", " ").splitlines()
        if "--page" in line
    ]  # fmt: skip
    words = [str(REPOSITORY / word) if word.startswith("docs/") else word for word in command[1:]]
    words = [str(tmp_path / Path(word).name) if word.startswith("out/") else word for word in words]

    metamerlab(*words)

    assert parts_of(made) == parts_of(kept), "renew it: script/docs --pictures gallery"


def test_the_pins_of_the_docs_agree_with_the_lock():
    pinned = [
        dict(re.findall(r"^([\w.-]+)==([\w.]+)", (REPOSITORY / name).read_text("utf-8"), re.M))
        for name in ("requirements.lock", "requirements-docs.txt")
    ]

    lock, docs = pinned
    assert {"sphinx", "myst-parser", "pydata-sphinx-theme"} <= set(docs) - set(lock)
    assert {
        name: version for name, version in docs.items() if lock.get(name, version) != version
    } == {}
    wanted = tomllib.loads((REPOSITORY / "pyproject.toml").read_text("utf-8"))
    for line in wanted["project"]["optional-dependencies"]["docs"]:
        assert line.partition(">=")[0] in docs
