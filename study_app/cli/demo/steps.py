"""The steps of a demonstration: commands of metamerlab, and what its page shows of each."""

from __future__ import annotations

import shlex
import tomllib
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

STUDY = "showcase"
SCREEN = "screen.toml"


@dataclass(frozen=True)
class Options:
    """Wishes of who runs `metamerlab demo`."""

    out: Path
    study: str = STUDY
    """Name or absolute path."""
    observers: int = 12
    window: bool = True
    """True if one of them sits before a real window."""
    display: str | None = None
    """The user's own screen, a name or an absolute path; None: a screen without a monitor."""
    seed: int = 0
    figures: bool = True
    studies: bool = True
    """True if foveated pictures, their studies and another task are shown too."""
    pictures_only: bool = False


@dataclass(frozen=True)
class Step:
    """One step: an entry of ``steps.toml``, whose texts may name options in braces."""

    name: str
    title: str
    text: str
    commands: list[str]
    """Run one after the other, in the folder of the demonstration."""
    when: str = ""
    """Option that must be on: ``study``, ``window`` or ``studies``; empty: it always runs."""
    each: list[str] = field(default_factory=lambda: [""])
    """Names that ``{name}`` stands for: all is done for each, and these share the processors."""
    makes: list[str] = field(default_factory=list)
    """Files that a finished step leaves."""
    links: dict[str, str] = field(default_factory=dict)
    """Place and words of what the page leads to."""
    shows: list[str] = field(default_factory=list)
    """Patterns of pictures, videos and pages that the page shows."""
    needs: list[str] = field(default_factory=list)
    """Steps whose results it reads: it is done again with them."""
    clears: list[str] = field(default_factory=list)
    """Patterns of what an earlier demonstration made, which goes before it is made anew."""

    def chains(self) -> list[list[list[str]]]:
        """Return the words of every command, for each name."""
        return [
            [shlex.split(text.replace("{name}", name)) for text in self.commands]
            for name in self.each
        ]

    def named(self, texts: list[str]) -> list[str]:
        """Return `texts` for each name."""
        return [text.replace("{name}", name) for name in self.each for text in texts]

    def all_links(self) -> list[tuple[str, str]]:
        """Return place and words of every link, for each name."""
        return list(
            zip(self.named(list(self.links)), self.named(list(self.links.values())), strict=True)
        )


def steps_of(options: Options, folder: str) -> list[Step]:
    """Return all steps that are asked for, in their order; `folder` is that of the sessions."""
    study = not options.pictures_only
    asked = {
        "": True,
        "study": study,
        "window": study and options.window,
        "studies": study and options.studies,
    }
    values = {
        "study": shlex.quote(options.study),
        "folder": folder,
        "display": shlex.quote(options.display or SCREEN),
        "pacing": "" if options.display else "--software-pacing",
        "seed": str(options.seed),
        "virtual": str(options.observers - options.window),
        "their": "S" if options.window else "",  # without a window all are on the virtual display
        "figures": "" if options.figures else "--no-figures",
        "name": "{name}",
    }
    text = (files("study_app.cli.demo") / "steps.toml").read_text(encoding="utf-8")
    steps = [Step(**entry) for entry in tomllib.loads(text)["steps"]]
    filled = ("commands", "makes", "clears")
    return [
        Step(**vars(step) | {key: [one.format(**values) for one in vars(step)[key]]
                             for key in filled})
        for step in steps if asked[step.when]
    ]  # fmt: skip
