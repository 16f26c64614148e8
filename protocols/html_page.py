"""Pages that stand alone: one HTML file each, of blocks, in the one style of all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files

from markupsafe import Markup


@dataclass(frozen=True)
class Figure:
    """A figure of a page: its caption, and SVG as `Markup`; another for small screens."""

    caption: str
    wide: str = ""
    narrow: str = ""
    width_rem: float | None = None
    """At most; None: that of all figures."""


def html_page(title: str, template: str = "protocols/page.html", **values: object) -> str:
    """Return a page.

    Parameters
    ----------
    title : str
        Of the browser's window; the page's own where there is no `heading`.
    template : str
        Package and file, which extends ``page.html``: ``stimuli/batch/contact.html``.
    values : object
        `heading`; `under` it a line; `stamp` on top of the page and over every printed one; `lead`
        blocks; `sections`; `figures` by the names in `FigurePlace`; and what the template names.

    Raises
    ------
    jinja2.UndefinedError
        If it names what is not given.
    """
    # Imported here: commands that only print their help need no templates.
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    package, _, name = template.rpartition("/")
    environment = Environment(
        loader=ChoiceLoader(
            [PackageLoader(package.replace("/", "."), "."), PackageLoader("protocols", "page")]
        ),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    style = files("protocols").joinpath("page/page.css").read_text(encoding="utf-8")
    usual: Mapping[str, object] = {
        "heading": "",
        "under": "",
        "stamp": "",
        "lead": (),
        "sections": (),
        "figures": {},
    }
    return environment.get_template(name).render(
        {**usual, **values, "title": title, "style": Markup(style)}
    )
