"""Regions to and from their part of the edit document."""

from __future__ import annotations

from dfd.editing.document import (
    BallDocument,
    BoxDocument,
    GroupDocument,
    HalfSpaceDocument,
    PartDocument,
    RegionDocument,
    VertexSetDocument,
)
from dfd.editing.influence.regions import Ball, Box, Group, HalfSpace, Part, Region, VertexSet
from dfd.posing.transforms import Vector

__all__ = ["region_from", "region_to"]


def region_to(region: Region | None) -> RegionDocument | None:
    """The document of `region`."""
    match region:
        case None:
            return None
        case Ball():
            return BallDocument(kind="ball", center=region.center, radius=region.radius)
        case Box():
            return BoxDocument(kind="box", low=region.low, high=region.high)
        case Group():
            return GroupDocument(kind="group", name=region.name)
        case HalfSpace():
            return HalfSpaceDocument(kind="half_space", normal=region.normal, offset=region.offset)
        case Part():
            return PartDocument(kind="part", name=region.name)
        case VertexSet():
            positions: list[Vector] = [(x, y, z) for x, y, z in region.positions.tolist()]
            return VertexSetDocument(
                kind="vertices", indices=region.indices.tolist(), positions=positions, count=region.count
            )


def region_from(document: RegionDocument) -> Region:
    """The region of a document.

    Raises
    ------
    ValueError
        If its numbers make no region.
    """
    match document:
        case BallDocument():
            return Ball(document.center, document.radius)
        case BoxDocument():
            return Box(document.low, document.high)
        case GroupDocument():
            return Group(document.name)
        case HalfSpaceDocument():
            return HalfSpace(document.normal, document.offset)
        case PartDocument():
            return Part(document.name)
        case VertexSetDocument():
            return VertexSet(document.indices, document.positions, document.count)
