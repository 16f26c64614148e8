"""Commands, links and texts of README and docs are true."""

import os
import re
import shlex
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import forked
import numpy as np
import pytest
from PIL import Image
from typer import Exit
from typer._click.exceptions import ClickException
from typer.core import TyperGroup
from typer.main import get_command

from study_app.cli import app

REPOSITORY = Path(__file__).resolve().parents[1]
README = REPOSITORY / "README.md"
CONTRIBUTING = REPOSITORY / "CONTRIBUTING.md"
SHOWN = Path("docs/images/fills.png")  # commands take it as their picture: here a smaller one
NOT_OURS = {".git", ".venv", "out", "dist", "build", "node_modules", "__pycache__"}

# Our own scripts set up machines and run these tests: that they exist is all
# that is asked of them here. `script/demo` is what `metamerlab demo` tests run.
SCRIPT = re.compile(r"(\./)?script/(?P<name>[\w-]+)")


def pages() -> list[Path]:
    return [README, CONTRIBUTING, *sorted((REPOSITORY / "docs").rglob("*.md"))]


def commands_in(text: str) -> list[str]:
    """Return the commands of every ```bash block; ```console blocks are only looked at."""
    blocks = re.findall(r"^```bash\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]


def anchors_in(text: str) -> set[str]:
    """Return the anchors that GitHub gives the headings of a page."""
    headings = re.findall(r"^#+ +(.+)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken_links(page: Path) -> list[str]:
    """Return every relative link of a page that leads nowhere."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        there = page.parent / name if name else page
        if not there.exists() or (
            anchor and anchor not in anchors_in(there.read_text(encoding="utf-8"))
        ):
            broken.append(f"{page.name}: {target}")
    return broken


def text_files(root: Path) -> list[tuple[Path, str]]:
    """Return every text file of the repository, with its text."""
    found = []
    for folder, folders, names in os.walk(root):
        folders[:] = [
            name
            for name in folders
            if name not in NOT_OURS and not name.endswith(("_cache", ".egg-info", ".hypothesis"))
        ]
        for name in names:
            if name in NOT_OURS:
                continue  # `.git` is a file in a worktree
            path = Path(folder, name)
            try:
                found.append((path, path.read_text(encoding="utf-8")))
            except (UnicodeDecodeError, OSError):
                continue  # a picture, or a link to nowhere
    return found


# Written in pieces, so that this file does not match itself.
HOSTS = [
    "pypi" + r"\.org",
    "python" + r"hosted\.org",
    "debian" + r"\.org",
    "ubuntu" + r"\.com/ubuntu",
    "file:" + "///",
]
FOLDERS = ["work", "root", "opt/" + "pypi", "opt/" + "wheels", "Users/" + r"\w+"]
PRIVATE = re.compile("|".join([*HOSTS, rf"(?<![\w./$}}~-])/(?:{'|'.join(FOLDERS)})/"]))


def private_names(text: str) -> list[str]:
    return [match.group() for match in PRIVATE.finditer(text)]


def made_by(command: str) -> str | None:
    """Return the file or folder that a command is told to write."""
    words = shlex.split(command, comments=True)
    return words[words.index("--out") + 1] if "--out" in words else None


def needed_for(command: str, commands: list[str]) -> list[str]:
    """Return the earlier commands of a page that write what this one reads."""
    words = shlex.split(command, comments=True)
    read = set(words) - {made_by(command)}
    return [other for other in commands[: commands.index(command)] if made_by(other) in read]


class Newcomer:
    """Types the README's commands in a folder that looks like the repository.

    Whatever is picked of the tests, and in whatever order: what a command reads is made before,
    and no command runs twice.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.commands = commands_in(README.read_text(encoding="utf-8"))
        self.done: dict[str, subprocess.CompletedProcess[str]] = {}
        for path in REPOSITORY.iterdir():
            if path.name not in {*NOT_OURS, "docs"}:
                (folder / path.name).symlink_to(path)
        (folder / SHOWN).parent.mkdir(parents=True)
        with Image.open(REPOSITORY / SHOWN) as picture:
            picture.reduce(3).save(folder / SHOWN)
        (folder / ".venv").mkdir()
        (folder / ".venv/bin").symlink_to(Path(sys.executable).parent)

    def run(self, command: str) -> subprocess.CompletedProcess[str]:
        """Run a command after those that it needs."""
        if command not in self.done:
            for other in needed_for(command, self.commands):
                self.run(other)
            program, *words = shlex.split(command, comments=True)
            if program == ".venv/bin/metamerlab" and not set("|&;<>$`") & set(command):
                self.done[command] = forked.run(*words, folder=self.folder, timeout=120)
            else:
                self.done[command] = subprocess.run(
                    ["bash", "-c", f"set -euo pipefail; {command}"],
                    cwd=self.folder,
                    capture_output=True,
                    text=True,
                    timeout=120,
                )
        return self.done[command]


@pytest.fixture(scope="module")
def newcomer(tmp_path_factory):
    return Newcomer(tmp_path_factory.mktemp("newcomer"))


@pytest.mark.slow
@pytest.mark.parametrize("command", commands_in(README.read_text(encoding="utf-8")))
def test_every_command_in_the_readme_exists_and_runs(newcomer, command):
    words = shlex.split(command, comments=True)
    if script := SCRIPT.fullmatch(words[0]):
        path = REPOSITORY / "script" / script["name"]
        assert os.access(path, os.X_OK), f"{path} is not there or not executable"
        return

    done = newcomer.run(command)

    # `doctor` answers 1 where the machine is unfit, which a build server may well be.
    fine = {0, 1} if "doctor" in words else {0}
    assert done.returncode in fine, f"{command}\n{done.stdout}{done.stderr}"
    assert "Traceback" not in done.stderr


def take(words: list[str]) -> None:
    """Let the program read a command's words, and run nothing (click's `ClickException`)."""
    command, context = get_command(app), None
    with suppress(Exit):  # --list
        while words:
            context = command.make_context("metamerlab", words, parent=context)
            if not isinstance(context.command, TyperGroup):
                return
            words = [*context._protected_args, *context.args]
            _, command, words = context.command.resolve_command(context, words)


@pytest.mark.slow
def test_the_program_takes_every_command_of_every_page():
    """Those of ```console blocks too, which take long, or need a tracker."""
    shown = re.compile(
        r"^ *```(?:bash|console|powershell)\n(.*?)^ *```", flags=re.MULTILINE | re.DOTALL
    )
    refused, taken = [], 0
    for page in pages():
        blocks = shown.findall(page.read_text(encoding="utf-8"))
        for line in "".join(blocks).replace("\\\n", " ").splitlines():
            found = re.match(r" *(?:\$ )?(?:\.venv/bin/)?metamerlab ([^|>&;#]+)", line)
            words = shlex.split(found[1]) if found else ["--help"]
            if "--help" in words or page.parent.name == "decisions":
                continue
            taken += 1
            try:
                take(words)
            except ClickException as error:
                refused.append(f"{page.name}: {line}: {error.format_message()}")

    assert taken > 200
    assert refused == []
    with pytest.raises(ClickException, match="No such option"):
        take(["stimuli", "build", "demo", "--no-such"])


def only_in_a_shell(line: str) -> str:
    """Return what PowerShell reads otherwise in a line that a shell takes; empty: nothing."""
    bare = re.sub(r'"[^"]*"', "QUOTED", line)  # both take it so, but for these:
    found = re.search(r"[\\`]$|\$|`|\\\"", line) or re.search(
        r"^(sed|head|tail|export|source|mkdir -p|rm -r|touch|grep)\b|<<|&&|@|~/|[\"']|\w,\w"
        r"|^metamerlab [^(]*\*",
        bare,
    )
    return found[0] if found else ""


@pytest.mark.parametrize(
    "page",
    [REPOSITORY / "docs/windows.md", *sorted((REPOSITORY / "docs/tutorials").glob("*.md"))],
    ids=lambda page: page.stem,
)
def test_a_tutorial_is_typed_into_powershell_as_it_is(page):
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(
        r"^```(?:bash|console|powershell)\n(.*?)^```", text, re.MULTILINE | re.DOTALL
    )
    lines = "".join(blocks).splitlines()

    assert lines
    assert [(line, found) for line in lines if (found := only_in_a_shell(line))] == []
    assert ("bin/activate" in text) <= ("Scripts\\Activate.ps1" in text)


@pytest.mark.parametrize(
    ("line", "caught"),
    [
        ("sed -i s/a/b/ study.toml", True),
        ("metamerlab warp a.png b.png \\", True),
        ("metamerlab warp a.png --methods telea,push-pull", True),
        ("python -c 'import cv2", True),
        ('python -c "import cv2', True),
        ("metamerlab new-study mine --photos *.jpg", True),
        ("source .venv/bin/activate", True),
        ('metamerlab warp a.png --methods "telea,push-pull"', False),
        ("python -c \"print('a', 'b')\"", False),
        (".venv\\Scripts\\python -m pip install (Get-Item dist/*.whl)", False),
    ],
)
def test_what_powershell_reads_otherwise_is_found(line, caught):
    assert bool(only_in_a_shell(line)) is caught


def options_of(command: TyperGroup, name: str = "metamerlab") -> dict[str, list[list[str]]]:
    """Return the spellings of every long option that help shows, by command."""
    found = {}
    for one in command.commands.values():
        slot = getattr(one, "_slot", None)
        whole, called = slot.load() if slot else one, f"{name} {one.name}"
        if isinstance(whole, TyperGroup):
            found |= options_of(whole, called)
        else:
            shown = [
                [*option.opts, *option.secondary_opts]
                for option in whole.params
                if option.param_type_name == "option" and not option.hidden
            ]
            found[called] = shown
    return found


def test_every_option_of_every_command_stands_on_a_page():
    text = "".join(page.read_text(encoding="utf-8") for page in pages())
    named = set(re.findall(r"(?<![\w-])--?[a-z][a-z0-9-]*", text))
    options = options_of(get_command(app))

    assert len(options) > 40
    assert ["--statistics", "--no-statistics"] in options["metamerlab compress"]
    missing = [
        f"{command} {spellings[0]}"
        for command, every in options.items()
        for spellings in every
        if not named & set(spellings)
    ]
    assert missing == []


def test_what_a_command_reads_is_made_before_it():
    commands = ["make a --out x/a", "look x/a", "join x/a x/b --out x/a", "make b --out x/b", "end"]

    needed = [needed_for(command, commands) for command in commands]

    assert needed == [[], ["make a --out x/a"], [], [], []]
    readme = commands_in(README.read_text(encoding="utf-8"))
    reading = [c for c in readme if "session list" in c or "analysis report" in c]
    made = [[before.split()[1:3] for before in needed_for(c, readme)] for c in reading]
    assert made == [[["session", "simulate"]]] * 2


def test_every_command_is_in_the_readme(repository):
    done = subprocess.run(
        [Path(sys.executable).parent / "metamerlab", "--help"],
        env={**os.environ, "TERM": "dumb", "COLUMNS": "120"},
        capture_output=True,
        text=True,
        check=True,
    )
    listing = done.stdout.partition("Commands")[2]
    names = re.findall(r"^\W*([a-z][\w-]*)  ", listing, flags=re.MULTILINE)
    readme = (repository / "README.md").read_text(encoding="utf-8")

    assert names, done.stdout
    missing = [name for name in names if f"metamerlab {name}" not in readme]
    assert not missing, f"not in README.md: {missing}"


def test_every_study_that_comes_along_is_in_the_readme(repository):
    text = (repository / "README.md").read_text(encoding="utf-8")
    names = [path.stem for path in (repository / "protocols/studies").glob("*.toml")]

    assert {"demo", "live-detection"} <= set(names)
    assert [name for name in names if f"`{name}`" not in text] == []


def test_every_script_is_explained(repository):
    text = "".join(page.read_text(encoding="utf-8") for page in pages())
    scripts = [
        path.name
        for path in (repository / "script").iterdir()
        if path.is_file() and not path.suffix
    ]

    assert {"setup", "demo", "test", "check", "bench"} <= set(scripts)
    assert [name for name in scripts if f"script/{name}" not in text] == []


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(REPOSITORY)))
def test_every_relative_link_leads_somewhere(page):
    assert broken_links(page) == []


@pytest.mark.parametrize(
    ("asked", "answered"),
    [
        ("my EyeLink", "tracker | `--gaze` | needs"),
        ("at home", "From a study to JATOS"),
        ("my network (ONNX)", "--methods onnx:ours.onnx"),
        ("How many participants", "`analysis power` simulates"),
        ("What does JOD mean", "75 % of observers"),
        ("Why was a trial repeated", "| `void_reason` | what happened |"),
    ],
)
def test_a_question_of_the_readme_leads_to_the_heading_that_answers_it(asked, answered):
    table = README.read_text(encoding="utf-8").partition("## Where to read on")[2]
    (row,) = [line for line in table.splitlines() if asked in line]
    page, _, anchor = re.findall(r"\]\(([^)]+)\)", row)[0].partition("#")
    text = (REPOSITORY / page).read_text(encoding="utf-8")

    parts = re.split(r"^(?=#+ )", text, flags=re.MULTILINE)
    begun = [n for n, part in enumerate(parts) if anchor in anchors_in(part)] if anchor else [0]
    first_screens = "".join(parts[begun[0] :])[:4000]
    assert answered in first_screens


def test_the_plug_in_of_the_contributing_page_fills_every_hole():
    text = CONTRIBUTING.read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    named: dict[str, type] = {}
    exec(code, named)
    hole = np.zeros((4, 4), bool)
    hole[1, 1] = True
    colour = np.full((4, 4, 3), 0.25, np.float32)
    colour[hole] = 0
    filled = named["MeanFill"]().fill(SimpleNamespace(colour=colour, hole=hole), seed=1)

    assert np.array_equal(filled, np.full((4, 4, 3), 0.25, np.float32))
    assert len([line for line in code[code.index("class ") :].splitlines() if line]) == 5


def test_every_folder_of_the_packages_is_explained(repository):
    text = (repository / "docs/architecture.md").read_text(encoding="utf-8")
    folders = {
        path.parent.relative_to(repository).as_posix()
        for package in ("analysis", "pipeline", "protocols", "stimuli", "study_app")
        for path in (repository / package).rglob("__init__.py")
    }

    assert {"stimuli/score", "study_app/cli/demo"} <= folders
    named = {folder for folder in folders if f"`{folder.rpartition('/')[2]}/`" in text}
    assert sorted(folder for folder in folders - named if f"`{folder}" not in text) == []


def test_the_pages_stay_short_enough_to_be_read():
    """Decisions, the reference of formats and tables that code writes are looked up, not read."""
    read = [page for page in pages() if page.parent.name not in ("decisions", "formats")]
    made = re.compile(r"<!-- ([\w ]+): begin -->.*?<!-- \1: end -->", flags=re.DOTALL)
    words = {page.name: made.sub("", page.read_text(encoding="utf-8")).split() for page in read}

    assert len(words) == len(read) > 25
    assert sum(1 for own in words.values() for word in own if re.search(r"\w", word)) <= 42_000


def test_every_decision_is_listed(repository):
    index = (repository / "docs/development.md").read_text(encoding="utf-8")
    records = sorted(path.name for path in (repository / "docs/decisions").glob("*.md"))

    assert [name for name in records if f"decisions/{name}" not in index] == []


def test_decision_numbers_are_unique(repository):
    numbers = [path.name[:4] for path in (repository / "docs/decisions").glob("*.md")]

    assert len(numbers) == len(set(numbers))


def test_every_changelog_fragment_is_one_line_of_a_known_kind(repository):
    folder = repository / "changelog.d"
    fragments = [p for p in folder.rglob("*") if p.is_file() and p.name != "README.md"]

    named = re.compile(
        r"((analysis|program|sessions|stimuli)/)?[\w-]+\.(added|changed|fixed|removed)\.md"
    )
    names = [p.relative_to(folder).as_posix() for p in fragments]
    assert [name for name in names if not named.fullmatch(name)] == []
    assert [p.name for p in fragments if len(p.read_text("utf-8").splitlines()) != 1] == []


def test_no_file_names_a_machine_or_a_package_host(repository):
    found = [
        f"{path.relative_to(repository)}: {name}"
        for path, text in text_files(repository)
        for name in private_names(text)
    ]

    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("text", "caught"),
    [
        ("see /" + "work/main", True),
        ('"/' + 'root/.cache"', True),
        ("--index https://" + "pypi" + ".org/simple", True),
        ("http://deb." + "debian" + ".org", True),
        ("docs/work/plan.md", False),
        ("$HOME/root/x", False),
    ],
)
def test_the_search_for_private_names_finds_them(text, caught):
    assert bool(private_names(text)) is caught


def test_a_broken_link_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A title\n[a](#a-title) [b](#none) [c](page.md) [d](gone.md) [e](ftp://x)\n")

    assert broken_links(page) == ["page.md: #none", "page.md: gone.md"]


def test_commands_are_read_from_bash_blocks_only():
    text = "```bash\n# why\nscript/test -k \\\n  warp\n\n```\n```console\nrm x\n```\n"

    assert commands_in(text) == ["script/test -k    warp"]
