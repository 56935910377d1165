# SPDX-License-Identifier: Apache-2.0
"""Envelope layers from what stays of the level sets once the core is filled."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Layer
from vega_planner.layers.contour import Sheet
from vega_planner.layers.core import Core, leant
from vega_planner.layers.folds import folded_ears
from vega_planner.layers.touching import fans_parted
from vega_planner.parallel import map_threads

#: Vertices and faces of what stays of a sheet, and which vertices these are, None for all.
_Stays = tuple[Floats, Ints, Ints | None]


def envelopes(
    sheets: list[Sheet], core: Core, lean: float, *, t: float, known: dict[int, list[_Stays]]
) -> list[Layer]:
    """Make layers of what stays of the level sets, as far as one is left.

    Args:
        sheets: The level sets, outermost first.
        core: What stays of them, and the room that each has.
        lean: How far they lean towards laying twice.
        t: Layer thickness [mm].
        known: What stays by the id of a core, where it has been found; added to.

    Returns:
        The layers, outermost first; empty ones at the end are left out.
    """
    if id(core) not in known:
        known[id(core)] = map_threads(
            lambda k: kept_faces(sheets[k], core.kept[k]), range(len(sheets))
        )

    def envelope(k: int) -> Layer:
        vertices, faces, rows = known[id(core)][k]
        thickness = leant(core.room[k], t, lean)
        if rows is not None:
            thickness = thickness[rows]
        thickness.flags.writeable = False  # or a layer would copy it
        return Layer(
            index=k,
            kind="envelope",
            depth_mm=sheets[k].depth,
            vertices=vertices,
            faces=faces,
            thickness=thickness,
        )

    layers = map_threads(envelope, range(len(sheets)))
    while layers and len(layers[-1].faces) == 0:
        layers.pop()
    return layers


def kept_faces(sheet: Sheet, kept: Bools) -> _Stays:
    """Leave out the faces of a sheet that are not kept, and the vertices only they use.

    Args:
        sheet: The sheet.
        kept: The faces that stay, shape (m,).

    Returns:
        Vertices [mm] and faces that stay, and which vertices these are, None for all.
    """
    # Two open edges and the one opposite to them are all on the rim.
    corners = sheet.rim[sheet.faces].sum(1) if sheet.rim.any() else np.zeros(0)
    if (corners == 3).any():
        beside = np.flatnonzero(corners >= 2)
        ears = folded_ears(sheet.vertices, sheet.faces[beside])
        kept = kept.copy()
        kept[beside[ears & (corners[beside] == 3)]] = False
    if kept.all():
        faces, rows = sheet.faces, np.arange(len(sheet.vertices))
    else:
        at_cut = np.zeros(len(sheet.vertices), bool)
        at_cut[sheet.faces[~kept]] = True
        faces, copied = fans_parted(sheet.faces[kept], at_cut)
        rows = np.append(np.arange(len(sheet.vertices)), copied)
        faces.flags.writeable = False  # or layers would copy them
    used = np.zeros(len(rows), bool)
    used[faces] = True
    if used.all() and len(rows) == len(sheet.vertices):
        return sheet.vertices, faces, None
    rows = rows[used]
    vertices, faces = sheet.vertices[rows], (np.cumsum(used) - 1)[faces]
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces, rows
