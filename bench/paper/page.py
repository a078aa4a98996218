"""Make the page of a figure or table of the paper: draw its pictures, fill its table, write Markdown, PNG and CSV."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import dfd
from bench.paper.subjects import NAMES, Context, Subject
from bench.quality.measures import area_fractions
from bench.tables import to_csv, to_markdown, write_text
from dfd.common.linear_algebra import Float64, UInt8
from dfd.pictures.contact_sheet import contact_sheet
from dfd.pictures.picture import picture, save_png
from dfd.pictures.sheet import session_views
from dfd.pictures.viewpoint import azimuth_towards

RESOLUTION = 320
Pictures = tuple[str, Sequence[tuple[UInt8, str]]]  # a heading, and pictures with their captions
Row = Mapping[str, Any]  # the cells of a table row by column name; a missing cell or None stays empty
Rule = Callable[[Sequence[Row]], float]  # computes one number from the table rows of a page


def aim(mesh: dfd.Mesh, points: Any, *moved: Float64, **more: Any) -> dict[str, Any]:
    """Return options of `picture` for a camera that faces `points` (N, 3) and shows the mesh and `moved` (V, 3)."""
    frame = [mesh.vertices, *moved]
    return {"azimuth": azimuth_towards(mesh, points), "frame": frame, "resolution": RESOLUTION, **more}


@dataclass(frozen=True)
class Page:
    """The content of a page: a text, pictures or a plot, and the rows of a table."""

    text: str
    pictures: Sequence[Pictures] = ()
    rows: Sequence[Row] = ()
    plot: Any = None  # a matplotlib figure; drawn only if there are no pictures


def gallery(
    subjects: Iterable[Subject],
    variants: Callable[[Subject], Mapping[str, dfd.Deformer]],
    measure: Callable[[Subject, dfd.Deformer, dfd.Deformer], Row],
    text: str = "",
    *,
    shown: Sequence[str] = ("weights", "after"),
    azimuth: float | None = None,
    source: Callable[[Subject], Mapping[str, Any]] = lambda subject: {},
) -> Page:
    """Return a page with pictures and a table row for each session. `variants` returns a subject's sessions by name.

    `measure` returns cells for the row of a session, from a subject, the session, and the subject's first session. Each
    view in `shown` gives a row of pictures; with one session, all views are in one row. The first picture of a row is
    the shape at rest, with options from `source`.
    """
    drawn: list[Pictures] = []
    rows: list[Row] = []
    for subject in subjects:
        sessions, mesh = variants(subject), subject.shape.mesh
        first = next(iter(sessions.values()))
        camera = session_views(first, getattr(subject.case, "azimuth", azimuth))["before"]
        views = {name: session_views(each, camera["azimuth"]) for name, each in sessions.items()}
        frame = [mesh.vertices, *(each.vertices for each in sessions.values() if each.mesh is mesh)]
        look: dict[str, Any] = {"resolution": RESOLUTION, "frame": frame}
        start = (picture(mesh, **{**camera, **look, **source(subject)}), "before")
        cells: dict[str, list[tuple[UInt8, str]]] = {what: [] for what in shown}
        for (name, each), what in product(sessions.items(), shown):
            options = {**views[name][what], **(look if each.mesh is mesh else {"resolution": RESOLUTION})}
            cells[what].append((picture(each.mesh, **options), name))
        title = f"{subject.shape.name}, {NAMES[subject.preset]}"
        if len(sessions) == 1:
            drawn.append((title, [start, *((row[0][0], what) for what, row in cells.items())]))
        else:
            drawn += [(f"{title}: {what}", [start, *row]) for what, row in cells.items()]
        for name, each in sessions.items():
            label = {"shape": subject.shape.name, "preset": NAMES[subject.preset], "variant": name}
            rows.append({**label, **measure(subject, each, first)})
    return Page(text, drawn, rows)


def following(session: dfd.Deformer, least: float) -> float:
    """Return the percentage of the surface area that follows the first handle with a weight above `least`."""
    return 100 * float(area_fractions(session.mesh)[session.following[:, 0] > least].sum())


@dataclass(frozen=True)
class Claim:
    """A claim of the paper in a figure or table, and the number that shows whether the result of dfd is alike."""

    paper: str  # the claim: a number, or what the pictures show
    measured: str  # what our number measures
    number: Rule  # computes our number
    least: float = -np.inf  # smallest number within our bound
    most: float = np.inf  # largest number within our bound
    cause: str = ""  # why the number may be outside

    def verdict(self, number: float, quick: bool) -> str:
        """Return a sentence that says whether the number is within our bound, and why if it is not."""
        if not np.isfinite(number):
            return f"Not decided: this run did not measure {self.measured}."
        within = self.least <= number <= self.most
        bound = f"at least {self.least:g}" if np.isfinite(self.least) else f"at most {self.most:g}"
        inputs = ", measured on the smaller inputs of --quick" if quick else ""
        said = f"{self.measured}: {number:.3g}, {'within' if within else 'outside'} our bound ({bound}){inputs}."
        return said if within or not self.cause else f"{said} Cause: {self.cause}"


def write(make: Callable[[Context], Page], claims: Sequence[Claim], name: str, folder: Path, context: Context) -> Path:
    """Write the page NAME.md, its pictures as PNG and its table as CSV; return the path of NAME.md."""
    folder.mkdir(parents=True, exist_ok=True)
    page = make(context)
    numbers = [claim.number(page.rows) for claim in claims]
    here = [f"{number:.3g}" if np.isfinite(number) else "not measured" for number in numbers]
    said = to_markdown(
        ["", "the paper", "here"], [[claim.measured, claim.paper, own] for claim, own in zip(claims, here, strict=True)]
    )
    verdicts = [f"- {each.verdict(number, context.quick)}" for each, number in zip(claims, numbers, strict=True)]
    title = (make.__doc__ or "").splitlines()[0]
    notes = "\n".join(f"- {note}" for note in context.notes())
    blocks = [f"# {name}: {title}", said, "\n".join(verdicts), notes, page.text]
    if page.pictures:
        save_png(folder / f"{name}.png", contact_sheet(page.pictures, cell=RESOLUTION))
    elif page.plot:
        page.plot.savefig(folder / f"{name}.png", dpi=100)
    if page.pictures or page.plot:
        blocks.append(f"![{title}]({name}.png)")
    columns = dict.fromkeys(key for row in sorted(page.rows, key=len, reverse=True) for key in row)
    cells = [[row.get(key) for key in columns] for row in page.rows]
    write_text(folder / f"{name}.csv", to_csv(columns, cells))
    write_text(folder / f"{name}.md", "\n\n".join([*filter(None, blocks), to_markdown(columns, cells)]) + "\n")
    return folder / f"{name}.md"
