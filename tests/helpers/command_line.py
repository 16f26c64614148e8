"""Commands of `metamerlab` as a user types them, run in this process."""

from collections.abc import Callable
from functools import partial
from typing import Any

from click.testing import Result
from typer.testing import CliRunner


def metamerlab(*words: object, status: int | None = 0, **options: Any) -> Result:
    """Run a command, which must end with a status (None: any); `options` are the runner's."""
    from study_app.cli import app

    done = CliRunner().invoke(app, [str(word) for word in words], **options)
    assert status in (None, done.exit_code), (done.exit_code, done.output, done.exception)
    return done


def result_of(*first: str, **options: Any) -> Callable[..., Result]:
    """Return a function that runs a command whose words begin so."""
    return partial(metamerlab, *first, **options)


def outcome_of(*first: str) -> Callable[..., tuple[int, str, str]]:
    """Return a function that runs a command and gives its status and both of its texts."""

    def parts(*more: object, status: int | None = 0) -> tuple[int, str, str]:
        done = metamerlab(*first, *more, status=status, catch_exceptions=False)
        return done.exit_code, done.stdout, done.stderr

    return parts


def refusal_of(*first: str) -> Callable[..., str]:
    """Return a function that runs a command, which must refuse in one message, and gives that."""
    run = outcome_of(*first)

    def said(*more: object) -> str:
        _, _, told = run(*more, status=2)
        assert told.lstrip().startswith("error: "), told  # a bar of progress ends before it
        assert "Traceback" not in told
        return told

    return said
