"""Make the page of a figure or table of the paper: draw its pictures, fill its table, judge the paper's claims."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import dfd
from bench.paper.subjects import NAMES, Context, Subject, agreement
from bench.quality.measures import area_fractions
from bench.tables import to_csv, to_markdown, write_text
from dfd.common.linear_algebra import Float64, UInt8
from dfd.pictures.contact_sheet import contact_sheet
from dfd.pictures.picture import picture, save_png
from dfd.pictures.sheet import session_views
from dfd.pictures.viewpoint import azimuth_towards

RESOLUTION = 320
HALF = 0.5  # smallest weight of vertices that count as following a handle
# Smallest "agreement %" with which a claim can hold. Of 900 sets of smooth random features on a table, 0.4 % reach it
# (`tests/python/bench/test_claims.py`).
ALIKE = 80.0
Pictures = tuple[str, Sequence[tuple[UInt8, str]]]  # a heading, and pictures with their captions
Row = Mapping[str, Any]  # the cells of a table row by column name; a missing cell or None stays empty
# Computes one number from the table rows of a page, for the rows whose method has the given name; NaN: not measured.
Rule = Callable[[Sequence[Row], str], float]


def aim(mesh: dfd.Mesh, points: Any, *moved: Float64, **more: Any) -> dict[str, Any]:
    """Return options of `picture` for a camera that faces `points` (N, 3) and shows the mesh and `moved` (V, 3)."""
    frame = [mesh.vertices, *moved]
    return {"azimuth": azimuth_towards(mesh, points), "frame": frame, "resolution": RESOLUTION, **more}


@dataclass(frozen=True)
class Page:
    """The content of a page: a text, pictures, and the rows of a table."""

    text: str
    pictures: Sequence[Pictures] = ()
    rows: Sequence[Row] = ()


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
    the shape at rest, with options from `source`. The row of the first session has the agreement with marked places.
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
        title = f"{subject.shape.name}, {subject.method}"
        if len(sessions) == 1:
            drawn.append((title, [start, *((row[0][0], what) for what, row in cells.items())]))
        else:
            drawn += [(f"{title}: {what}", [start, *row]) for what, row in cells.items()]
        for name, each in sessions.items():
            label = {"shape": subject.shape.name, "method": subject.method, "variant": name}
            alike = agreement(mesh, subject.case, each.following[:, 0]) if each is first else None
            rows.append({**label, "agreement %": alike, **measure(subject, each, first)})
    return Page(text, drawn, rows)


def following(session: dfd.Deformer) -> float:
    """Return the percentage of the surface area that follows the first handle with a weight above `HALF`."""
    return 100 * float(area_fractions(session.mesh)[session.following[:, 0] > HALF].sum())


@dataclass(frozen=True)
class Claim:
    """A claim of the paper in a figure or table, and the number that shows whether it holds for dfd."""

    paper: str  # the claim
    measured: str  # what our number measures
    number: Rule
    least: float = -np.inf  # smallest number with which the claim holds
    most: float = np.inf  # largest number with which the claim holds
    marked: bool = True  # whether the claim can hold only if marked places follow as they should (`ALIKE`)

    @property
    def bound(self) -> str:
        """Return the bound as text."""
        return f"≥ {self.least:g}" if np.isfinite(self.least) else f"≤ {self.most:g}"

    def judged(self, rows: Sequence[Row], own: str) -> tuple[float, str]:
        """Return the number of the method `own`, and the verdict: yes, no, or not decided.

        If the page has an agreement with marked places, and it is below `ALIKE`, the verdict is no.
        """
        number = self.number(rows, own)
        found = [row["agreement %"] for row in rows if row["method"] == own and row.get("agreement %") is not None]
        if self.marked and found and np.mean(found) < ALIKE:
            return number, f"no: {np.mean(found):.0f} % agreement"
        if not np.isfinite(number):
            return number, "not decided"
        return number, "yes" if self.least <= number <= self.most else "no"


@dataclass(frozen=True)
class Figure:
    """A figure or table of the paper: the function that makes its page, and the paper's claims."""

    make: Callable[[Context], Page]
    claims: Sequence[Claim]
    cause: str = ""  # why a claim may not hold

    @property
    def title(self) -> str:
        """Return what the page shows, in one sentence."""
        return (getattr(self.make, "title", None) or self.make.__doc__ or "").splitlines()[0]


def write(figure: Figure, name: str, folder: Path, context: Context) -> Path:
    """Write the page NAME.md, its pictures as PNG and its table as CSV; return the path of NAME.md."""
    folder.mkdir(parents=True, exist_ok=True)
    page = figure.make(context)
    said, cause = [], ""
    for claim in figure.claims:
        judged = [claim.judged(page.rows, own) for own in NAMES.values()]
        said.append([claim.paper, claim.measured, claim.bound, *(f"{number:.3g}: {word}" for number, word in judged)])
        if figure.cause and any(word.startswith("no") and word != "not decided" for _, word in judged):
            cause = f"Cause: {figure.cause}."
    verdicts = to_markdown(["the paper's claim", "our number", "our bound", *NAMES.values()], said)
    blocks = [f"# {name}: {figure.title}", verdicts, cause, "\n".join(f"- {n}" for n in context.notes())]
    blocks.append(page.text)
    if page.pictures:
        save_png(folder / f"{name}.png", contact_sheet(page.pictures, cell=RESOLUTION))
        blocks.append(f"![{figure.title}]({name}.png)")
    columns = dict.fromkeys(key for row in sorted(page.rows, key=len, reverse=True) for key in row)
    cells = [[row.get(key) for key in columns] for row in page.rows]
    write_text(folder / f"{name}.csv", to_csv(columns, cells))
    write_text(folder / f"{name}.md", "\n\n".join([*filter(None, blocks), to_markdown(columns, cells)]) + "\n")
    return folder / f"{name}.md"
