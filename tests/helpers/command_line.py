"""Commands of `metamerlab` as a user types them, run in this process."""

from collections.abc import Callable
from typing import Any

from click.testing import Result
from typer.testing import CliRunner


def result_of(*first: str, **options: Any) -> Callable[..., Result]:
    """Return a function that runs a command whose words begin so; `options` are the runner's."""

    def run(*more: object) -> Result:
        from study_app.cli import app

        return CliRunner().invoke(app, [*first, *map(str, more)], **options)

    return run


def outcome_of(*first: str) -> Callable[..., tuple[int, str, str]]:
    """Return a function that runs a command and gives its status and both of its texts."""
    run = result_of(*first, catch_exceptions=False)

    def parts(*more: object) -> tuple[int, str, str]:
        result = run(*more)
        return result.exit_code, result.stdout, result.stderr

    return parts


def refusal_of(*first: str) -> Callable[..., str]:
    """Return a function that runs a command, which must refuse in one message, and gives that."""
    run = outcome_of(*first)

    def said(*more: object) -> str:
        code, _, told = run(*more)
        assert code == 2, told
        assert told.startswith("error: "), told
        assert "Traceback" not in told
        return told

    return said
