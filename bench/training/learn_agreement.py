"""Learn the probability that a handle transferred to another rig of its family moves the corresponding part.

A handle moves the subtrees of some joints of its rig. A transferred handle is right (correct) if it moves those of the
same joints of the other rig. Both IoUs must be at least 0.6. `python -m bench.training.learn_agreement FOLDER…` prints
the constants of `dfd.editing.agreement`. To test them, it predicts each family by constants from the other families.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

import dfd
from bench.quality.anatomy import RiggedShape, rigged_shapes
from bench.quality.measures import soft_iou
from bench.quality.parts import family_of
from dfd.common.linear_algebra import Bool, Float64
from dfd.editing.agreement import MOVED, differences
from dfd.editing.edit import Edit
from dfd.editing.transfer import transfer

RIGHT = 0.6  # a handle is right if the IoU between the moved vertices and the subtrees is at least this
SHARED = 0.6  # handles are transferred to rigs with more than this fraction of the own rig's joint names
TARGETS = 3  # largest number of rigs to which each handle is transferred
FAMILY_POWER = 0.5  # the weight of a family is its number of handles, raised to this power


def transferred(shapes: list[tuple[RiggedShape, dfd.Deformer]]) -> Iterator[tuple[str, Float64, bool]]:
    """Transfer a handle of each joint to other rigs; yield its family, `differences` (2,), and whether it is right."""
    generator = np.random.default_rng(0)
    for shape, session in shapes:
        family, names = family_of(shape.name), set(shape.joints)
        kin = [each for each in shapes if family_of(each[0].name) == family and each[0] is not shape]
        others = [each for each in kin if len(names & set(each[0].joints)) > SHARED * len(names)]
        for handles in shape.handles() if others else ():
            session.apply(Edit())
            session.add(int(handles[0]))
            moved = session.following[:, 0] >= MOVED
            meant = [(soft_iou(shape.areas, moved, inside), joints) for joints, inside in shape.meant(int(handles[0]))]
            overlap, joints = max(meant, default=(0.0, []))
            for index in generator.permutation(len(others))[:TARGETS] if overlap >= RIGHT else ():
                other, target = others[index]
                if set(joints) <= set(other.joints):
                    parts = session.bound.parts, target.bound.parts
                    found = transfer(session.edit, session.mesh, session.field, target.mesh, target.field, parts=parts)
                    target.apply(found.edit)
                    wanted = np.any([other.subtree(other.joints.index(joint)) for joint in joints], axis=0)
                    shared = soft_iou(other.areas, target.following[:, 0] >= MOVED, wanted)
                    yield family, differences(session, target)[0], shared >= RIGHT


def fitted(rows: Float64, right: Bool, weight: Float64) -> Float64:
    """Return the constants (3,) of `agreement` by weighted maximum likelihood, from `rows` (N, 2) and `right` (N,)."""
    sign = np.where(right, -1.0, 1.0)

    def loss(constants: Float64) -> float:
        return float(weight @ np.logaddexp(0.0, sign * (constants[0] - rows @ constants[1:])))

    return np.asarray(minimize(loss, np.zeros(3)).x)


def main() -> None:
    """Learn the constants from the rigs of all given folders, and print them."""
    parser = argparse.ArgumentParser("python -m bench.training.learn_agreement", description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+", help="folders with skinned GLB files")
    shapes = [
        (shape, dfd.Deformer(shape.mesh, dfd.distill(shape.mesh, progress=False)))
        for folder in parser.parse_args().folders
        for shape in rigged_shapes(folder)
    ]
    found = list(transferred(shapes))
    families = np.array([family for family, *_ in found])
    rows, right = np.array([row for _, row, _ in found]), np.array([each for *_, each in found])
    weight = np.array([(families == family).sum() ** (FAMILY_POWER - 1.0) for family in families])
    log_odds = np.zeros(len(found))
    for family in set(families):
        kept = families != family
        constants = fitted(rows[kept], right[kept], weight[kept])
        log_odds[~kept] = constants[0] - rows[~kept] @ constants[1:]
    confidence = 1.0 / (1.0 + np.exp(-log_odds))
    print(f"{len(found)} handles, {right.mean():.1%} right; constants {fitted(rows, right, weight).round(2)}")
    for least in (0.5, 0.7, 0.8, 0.9):
        some = confidence >= least
        print(f"probability of at least {least}: {some.sum()} handles, {right[some].mean():.1%} right")


if __name__ == "__main__":
    main()
