"""Figures as part of a page."""

import re


def inline_svg(svg: bytes, name: str, title: str) -> str:
    """Return an SVG file as an element for HTML: own names inside, a title for screen readers."""
    text = svg.decode("utf-8")
    text = text[text.index("<svg") :]
    # Names must differ between the figures of one page.
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r"url\(#", f"url(#{name}-", text)
    text = re.sub(r'(xlink:href|href)="#', rf'\1="#{name}-', text)
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    escaped = title.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return text.replace("<svg ", f'<svg role="img" aria-label="{escaped}" ', 1)
