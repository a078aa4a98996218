"""The effect of an edit in a few words for the page, with details on demand."""

from collections.abc import Mapping

from dfd.editing.edit import Edit
from dfd.editing.report import LEAST_STRETCH, HandleReport, Report, percent


def summary(report: Report, edit: Edit) -> str:
    """Return what moved and how far, for example "4 × leg moved by 0.21; edges stretched 2.9×"."""
    if report.warning is not None:
        return report.warning[:1].upper() + report.warning[1:]
    moved = [each for each, handle in zip(report.handles, edit.handles, strict=True) if not handle.transform.rests]
    told = [f"{_who(moved)} moved by {report.farthest:.2g}"]
    if report.stretch >= LEAST_STRETCH:
        told.append(f"edges stretched {report.stretch:.1f}×")
    told += [f"{_name(each)} is {each.missing:.2g} from its target" for each in moved if not each.arrived]
    return "; ".join(told)


def details(report: Report, steps: Mapping[int, str]) -> tuple[str, ...]:
    """Return one sentence about the whole shape and one about each handle. `steps` has the steps of parts in words."""
    if report.warning is not None:
        return ()
    told = [f"{percent(report.moved)} of the vertices moved, up to {report.farthest:.3g}."]
    for each in report.handles:
        words = f"{_name(each)} arrived" if each.arrived else f"{_name(each)} is {each.missing:.3g} from its target"
        if each.counterparts > 1:
            words += f", with {each.counterparts - 1} alike, each about its own pivot"
        if each.mirrored is not None:
            words += ", mirrored"
        if each.step:
            words += f", step {steps[each.id]}"
        told.append(f"{words}{'' if each.note is None else f', {each.note}'}.")
    return (*told, *([] if report.advice is None else [f"{report.advice}."]))


def _who(moved: list[HandleReport]) -> str:
    if not moved:
        return "The rest of the shape"
    if len(moved) > 1:
        return f"{len(moved)} handles"
    (one,) = moved
    named = one.name or ("part" if one.counterparts == 1 else "parts")
    return f"{one.counterparts} {'× ' if one.name else ''}{named}" if one.counterparts > 1 else _name(one)


def _name(one: HandleReport) -> str:
    return one.name or f"Handle {one.id}"
