# SPDX-License-Identifier: Apache-2.0
"""The two sides of a sheet, and from which one each of its faces is printed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Layer
from vega_planner.printability.islands import neighbours_of, without_islands

OUTSIDE, INSIDE, NEITHER = 1, -1, 0

#: Regions smaller than this many squared layer thicknesses are noise of the labels.
ISLAND = 9.0


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a sheet as the nozzle sees it.

    Attributes:
        axes: Unit tool axes at the vertices, shape (n, 3).
        code: 0 where printable from this side, else 1 + index into `REASON_CODES`, (n,).
        reachable: True where the robot gets there (f1), shape (n,).
        seen: True where the line along the tool meets nothing of the layer (f2), (n,).
        clear: True where the solid tool is clear (f2s), shape (n,).
        hopeful: True where only the lean stands against printing, on a wall whose beads
            stand on each other; or only material that need not be there yet, if it is
            printed from the bottom up. The check of every waypoint decides. Shape (n,).
    """

    axes: Floats
    code: Ints
    reachable: Bools
    seen: Bools
    clear: Bools
    hopeful: Bools

    @property
    def printable(self) -> Bools:
        """True for the vertices that can be printed from this side, shape (n,)."""
        return self.code == 0


@dataclass(frozen=True, eq=False)
class SheetAssessment:
    """Judgement of one sheet.

    Attributes:
        outside: The side the normals point to.
        inside: The other side; None where the outer one serves everywhere.
        side: Side each face is printed from: 1 outside, -1 inside, 0 neither, shape (m,).
    """

    outside: Side
    inside: Side | None
    side: Ints


def face_labels(layer: Layer, outside: Side, inside: Side | None, held: Bools) -> Ints:
    """Choose the side each face is printed from, by the majority of its corners.

    What faces down and lies on something is printed from inside, as a bowl is, where that
    can be done; all else from outside where that can be done.
    """
    faces = layer.faces
    out = outside.printable[faces].sum(1) >= 2
    label = np.where(out, OUTSIDE, NEITHER)
    if inside is not None:
        within = inside.printable[faces].sum(1) >= 2
        label[within & (~out | (held[faces].sum(1) >= 2))] = INSIDE
    return label


def with_hope(layer: Layer, outside: Side, label: Ints, flat: bool) -> tuple[Side, Ints]:
    """Print from outside what is only hopeful, where there is no other way.

    On a flat base nothing has to be printed from inside: there, all of it.
    """
    wanted = label != OUTSIDE if flat else label == NEITHER
    if not outside.hopeful.any() or not wanted.any():
        return outside, label
    good = outside.printable | outside.hopeful
    more = wanted & (good[layer.faces].sum(1) >= 2)
    if not more.any():
        return outside, label
    used = np.zeros(len(good), np.bool_)
    used[layer.faces[more].ravel()] = True
    code = np.where(used & outside.hopeful, 0, outside.code)
    return replace(outside, code=code), np.where(more, OUTSIDE, label)


def with_hope_inside(layer: Layer, inside: Side, label: Ints) -> tuple[Side, Ints]:
    """Print from inside what is hopeful there, where there is no way from outside at all.

    Deep in a bowl the walls that are there when whole layers follow each other stand in
    the way; they need not be there yet where all is printed from the bottom up.
    """
    wanted = label == NEITHER
    if not wanted.any() or not inside.hopeful.any():
        return inside, label
    good = inside.printable | inside.hopeful
    more = wanted & (good[layer.faces].sum(1) >= 2)
    used = np.zeros(len(good), np.bool_)
    used[layer.faces[more].ravel()] = True
    code = np.where(used & inside.hopeful, 0, inside.code)
    return replace(inside, code=code), np.where(more, INSIDE, label)


def without_noise(layer: Layer, label: Ints) -> Ints:
    """Give regions too small for a few beads the side of what surrounds them."""
    if (label == label[0]).all():
        return label
    island = ISLAND * float(np.median(layer.bead_thickness)) ** 2
    return without_islands(neighbours_of(layer), layer.face_areas, label, island)
