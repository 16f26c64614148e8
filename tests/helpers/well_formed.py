"""Pages whose tags close in order, whose ids are unique, and whose links lead to them."""

import re
from html.parser import HTMLParser

VOID = {"meta", "br", "img", "use", "path", "image", "rect"}


class Checker(HTMLParser):
    """Follows the tags of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.ids += [value for key, value in attrs if key == "id" and value]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag


def check_well_formed(html: str) -> None:
    """Assert that a page is well-formed."""
    checker = Checker()
    checker.feed(html)
    assert checker.open == []
    assert len(checker.ids) == len(set(checker.ids))
    assert set(re.findall(r'href="#([^"]+)"', html)) <= set(checker.ids)
