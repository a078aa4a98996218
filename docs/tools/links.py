"""Every link and picture of the built pages leads to a file that is there, and to a name that stands in it."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from sphinx.application import Sphinx
from sphinx.util import logging

log = logging.getLogger(__name__)


def setup(app: Sphinx) -> dict[str, bool]:
    """Look once all pages are written."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


class _Page(HTMLParser):
    """The names of places on a page, and where it leads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.links: set[str] = set()
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and name == "id":
                self.names.add(value)
            elif value and name in ("href", "src"):
                self.links.add(value)


def _check(app: Sphinx, exception: Exception | None) -> None:
    if exception or app.builder.name != "html":
        return
    names = [app.env.doc2path(name, base=False) for name in app.env.found_docs]
    pages = {path: _Page(path) for path in (Path(app.outdir, name).with_suffix(".html").resolve() for name in names)}
    for path, page in pages.items():
        for link in sorted(page.links):
            split = urlsplit(link)
            if split.scheme or split.netloc:
                continue
            target = (path.parent / unquote(split.path)).resolve() if split.path else path
            place = unquote(split.fragment)
            if not target.exists() or (place and target in pages and place not in pages[target].names):
                log.warning("%s leads to %s, which is not there", path.relative_to(app.outdir), link)
