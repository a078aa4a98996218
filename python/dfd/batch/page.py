"""Write the web page of a batch. The page shows all shapes with their pictures; failed shapes come first."""

from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from dfd.batch.record import CAUSES, FAILED_EXPORT, Record
from dfd.common.files import write_file

HEAD = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>{title}</title>
<style>
body {{ font: 14px/1.4 system-ui, sans-serif; color: #1c1e24; margin: 2rem; }}
main {{ display: grid; grid-template-columns: repeat(auto-fill, minmax(180px, 1fr)); gap: 1rem; }}
article {{ border: 1px solid #dcdee2; padding: .5rem; overflow-wrap: anywhere; }}
article.failed {{ border-color: #c0392b; background: #fdf3f2; }}
img {{ width: 100%; aspect-ratio: 1; object-fit: contain; background: white; }}
small {{ color: #64686f; display: block; }}
</style>
<h1>{title}</h1>
<p>Steps: {steps}. <a href='shapes.jsonl'>shapes.jsonl</a></p>
<main>
"""


def tally(records: Sequence[Record]) -> str:
    """Return a text with the number of finished shapes, and the number of failed shapes for each cause."""
    causes = Counter(record.cause for record in records)
    failed = "".join(f", {count:,} failed: {CAUSES[cause]}" for cause, count in causes.most_common() if cause)
    return f"{causes[None]:,} done{failed}"


def write_page(root: Path, steps: Sequence[str], records: Sequence[Record]) -> None:
    """Write `shapes.jsonl`, one record per line, and `index.html` into the folder of a batch.

    Raises OSError if a file cannot be written.
    """
    write_file(root / "shapes.jsonl", "".join(f"{record.line}\n" for record in records))
    title = escape(f"{len(records):,} shapes: {tally(records)}")
    ordered = sorted(records, key=lambda record: (record.status == "done", record.name))
    text = HEAD.format(title=title, steps=", ".join(steps)) + "".join(map(_article, ordered)) + "</main>\n</html>\n"
    write_file(root / "index.html", text.encode(errors="backslashreplace"))


def _article(record: Record) -> str:
    link = f"shapes/{quote(record.name)}"
    pictures = [name for name in record.files if name.endswith(".png")]
    pictures.sort(key=lambda name: name != "thumbnail.png")
    images = "".join(
        f"<a href='{link}/{quote(name)}'><img loading='lazy' src='{link}/{quote(name)}' alt='{escape(name)}'></a>"
        for name in pictures
    )
    lines = [f"{record.figures['faces']:,} faces"] if "faces" in record.figures else []
    lines += [f"{record.seconds:.1f} s"]
    if record.cause is not None:
        lines += [f"{CAUSES[record.cause]}: {record.message}"]
    else:
        failed = (text for name, text in record.figures.items() if name.endswith(FAILED_EXPORT))
        lines += [*record.transfers(), *(str(text) for text in failed if text)]
    text = "".join(f"<small>{escape(line)}</small>" for line in lines)
    return f"<article class='{record.status}'>{images}<a href='{link}/'>{escape(record.name)}</a>{text}</article>\n"
