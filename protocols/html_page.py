"""Pages that stand alone: one HTML file each, of a template and the one style of all."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from markupsafe import Markup


@cache
def style() -> Markup:
    """Return the style of all pages, for a `<style>`; a template adds what is its own."""
    return Markup(files("protocols").joinpath("page.css").read_text(encoding="utf-8"))


def html_page(package: str, template: str, **values: object) -> str:
    """Return a page.

    Parameters
    ----------
    package : str
        The package beside whose modules the template lies: ``stimuli.score``.
    template : str
        Its file. `style` stands for the style of all pages.
    values : object
        What the template names.

    Raises
    ------
    jinja2.UndefinedError
        If it names what is not given.
    """
    # Imported here: commands that only print their help need no templates.
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader(package, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(style=style(), **values)
