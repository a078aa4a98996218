"""The page of a batch: every shape with its thumbnail, failures first; it opens from the folder, without a server."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from dfd.batch.folder import BatchFolder
from dfd.batch.record import Record
from dfd.batch.settings import BatchSettings
from dfd.common.files import atomic_write

__all__ = ["PAGE", "write_page"]

PAGE = "index.html"
ON_A_PAGE = 2000  # shapes; more go on in index-2.html and so on

HEAD = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>{title}</title>
<style>
body {{ font: 14px/1.4 system-ui, sans-serif; color: #1c1e24; margin: 2rem; }}
h1 {{ font-size: 1.3rem; font-weight: 600; }}
nav a, nav b {{ margin-right: .6rem; }}
main {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(180px, 1fr)); gap: 1rem; }}
article {{ border: 1px solid #dcdee2; border-radius: 6px; padding: .5rem; overflow-wrap: anywhere; }}
article.failed {{ border-color: #c0392b; background: #fdf3f2; }}
img {{ width: 100%; aspect-ratio: 1; object-fit: contain; background: white; }}
small {{ color: #64686f; display: block; }}
a {{ color: inherit; }}
</style>
"""


def write_page(folder: BatchFolder, settings: BatchSettings, records: Sequence[Record]) -> Path:
    """Write `index.html`, and further pages where there are more than 2,000 shapes.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    ordered = sorted(records, key=lambda record: (record.status == "done", record.name))
    starts = range(0, max(1, len(ordered)), ON_A_PAGE)
    counts = Counter(record.cause or record.status for record in records)
    told = ", ".join(f"{count:,} {what}" for what, count in counts.most_common())
    title = f"{len(records):,} shapes: {told}"
    for number, start in enumerate(starts, 1):
        path = folder.root / _page_name(number)
        with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as stream:
            stream.write(HEAD.format(title=escape(title)) + f"<h1>{escape(title)}</h1>\n")
            stream.write(f"<p>Steps: {', '.join(settings.steps)}. <a href='shapes.parquet'>shapes.parquet</a></p>\n")
            if len(starts) > 1:
                stream.write("<nav>" + "".join(_links(len(starts), number)) + "</nav>\n")
            stream.write("<main>\n")
            stream.writelines(_article(folder, record) for record in ordered[start : start + ON_A_PAGE])
            stream.write("</main>\n</html>\n")
    return folder.root / PAGE


def _page_name(number: int) -> str:
    return PAGE if number == 1 else f"index-{number}.html"


def _links(count: int, here: int) -> Iterator[str]:
    for number in range(1, count + 1):
        yield f"<b>{number}</b>" if number == here else f"<a href='{_page_name(number)}'>{number}</a>"


def _article(folder: BatchFolder, record: Record) -> str:
    place = quote(folder.shape(record.name).relative_to(folder.root).as_posix())
    shown = [name for name in record.files if name.endswith(".png")]
    shown.sort(key=lambda name: (name != "thumbnail.png", name))
    images = "".join(
        f"<a href='{place}/{quote(name)}'><img loading='lazy' src='{place}/{quote(name)}' alt='{escape(name)}'></a>"
        for name in shown
    )
    lines = [f"{record.seconds:.1f} s"]
    if "faces" in record.figures:
        lines.insert(0, f"{record.figures['faces']:,} faces")
    refused = [str(text) for name, text in record.figures.items() if name.endswith("_refused") and text]
    lines += [f"{record.cause}: {record.message}"] if record.cause else refused
    text = "".join(f"<small>{escape(line)}</small>" for line in lines)
    return f"<article class='{record.status}'>{images}<a href='{place}/'>{escape(record.name)}</a>{text}</article>\n"
