"""The report of an export, in numbers and as one sentence."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dfd.export.rig import Rig
from dfd.export.skinning import Difference, Skin


@dataclass(frozen=True, kw_only=True)
class RigReport:
    """The report of a written file: its contents, and its deviation from the result of `dfd.pose`."""

    path: Path
    form: str  # "skin", "morph" or "baked"
    joints: int = 0  # 0 without a skin
    influences: int = 0  # largest number of joints that a vertex follows
    targets: int = 0  # number of morph targets
    pruned: float = 0.0  # largest fraction of a vertex's total weight that the limit of joints removed
    normalized: int = 0  # number of vertices whose weights were changed: a weight was negative, or the sum above 1
    largest: float  # largest distance of a vertex in the file from the result of `dfd.pose`, mesh units
    mean: float  # mean of these distances in the pose `at`, mesh units
    at: str  # the pose with the largest distance: "the edit", or the name of a key pose
    size: float  # the diagonal of the resting shape's bounding box, mesh units
    notes: tuple[str, ...] = ()  # sentences about other differences between the file and the edit

    def __str__(self) -> str:
        what = {
            "skin": f"{self.joints} joints, up to {self.influences} for a vertex",
            "morph": f"{self.targets} morph targets" if self.targets != 1 else "1 morph target",
            "baked": "the moved shape",
        }[self.form]
        sentences = [what, self._difference()]
        if self.pruned > 0.0005:
            sentences.append(f"up to {100 * self.pruned:.2g} % of a vertex's weight pruned")
        if self.normalized:
            sentences.append(f"weights of {self.normalized} vertices, negative or with a sum above 1, normalized")
        return "; ".join([*sentences, *self.notes])

    def _difference(self) -> str:
        if self.largest <= 1e-6 * self.size:
            return "no deviation from dfd.pose"
        parts = [f"{value:.2g} ({100 * value / (self.size or 1.0):.2g} %)" for value in (self.largest, self.mean)]
        where = "" if self.at == "the edit" else f", most at {self.at}"
        return f"maximum deviation from dfd.pose: {parts[0]}, {parts[1]} on average{where}"


def report_of(
    rig: Rig,
    path: Path,
    form: str,
    difference: Difference,
    *,
    skin: Skin | None = None,
    targets: int = 0,
    notes: tuple[str, ...] = (),
) -> RigReport:
    """Return the report of a rig that was written to the file `path`; `difference` is its deviation from `dfd.pose`."""
    where: dict[str, Any] = {**vars(difference), "size": rig.mesh.diagonal, "targets": targets}
    if skin is not None:
        where |= {"joints": len(rig.joints), "influences": skin.joints.shape[1]}
        where |= {"pruned": skin.pruned, "normalized": skin.normalized}
        if rig.edit.blending != "linear":
            notes += (f"the edit blends as {rig.edit.blending}, but a skin blends linearly",)
        if any(handle.transform.bends for _, edit in rig.moments() for handle in edit.handles):
            notes += ("a skin has no bends and twists; the forms 'morph' and 'baked' have them",)
    return RigReport(path=path, form=form, notes=notes, **where)
