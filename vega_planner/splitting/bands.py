# SPDX-License-Identifier: Apache-2.0
"""Cut patches into bands of height, for patches that wait for each other."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Patch
from vega_planner.part.topology import connected_pieces
from vega_planner.splitting.cut import Cut, cut_mesh

#: Pieces smaller than this share of a squared layer thickness hold no bead.
CRUMB = 0.5


def bands(patch: Patch, heights: list[float]) -> list[Patch]:
    """Cut a patch at some heights, lowest band first.

    Printed bottom up like the layers of an ordinary slicer, the bands of patches that
    would stand in each other's way leave the nozzle room.

    Args:
        patch: The patch.
        heights: Heights of the cuts [mm], rising.

    Returns:
        The connected pieces; the patch itself where no height cuts it.
    """
    made: list[Patch] = []
    rest = patch
    for height in heights:
        z = rest.vertices[:, 2]
        if z.min() >= height - 1e-6:
            continue
        if z.max() <= height + 1e-6:
            break
        cut = cut_mesh(rest.vertices, rest.faces, height - z)
        below = _part(rest, cut, cut.positive)
        above = _part(rest, cut, ~cut.positive)
        if below is not None:
            made += _pieces(below)
        if above is None:
            return made
        rest = above
    return made + (_pieces(rest) if made else [patch])


def _part(patch: Patch, cut: Cut, chosen: np.ndarray) -> Patch | None:
    faces = cut.faces[chosen]
    if not len(faces):
        return None
    axes = cut.carry(patch.tool_axes)
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    thickness = cut.carry(patch.thickness)
    return _compact(patch.layer, cut.vertices, faces, thickness, axes)


def _pieces(patch: Patch) -> list[Patch]:
    piece, count = connected_pieces(len(patch.vertices), patch.faces)
    least = CRUMB * float(patch.thickness.min()) ** 2
    found = []
    for k in range(count):
        chosen = piece == k
        if float(patch.face_areas[chosen].sum()) >= least:
            found.append(
                _compact(
                    patch.layer,
                    patch.vertices,
                    patch.faces[chosen],
                    patch.thickness,
                    patch.tool_axes,
                )
            )
    return found


def _compact(
    layer: int, vertices: np.ndarray, faces: np.ndarray, thickness: np.ndarray, axes: np.ndarray
) -> Patch:
    used = np.zeros(len(vertices), np.bool_)
    used[faces.ravel()] = True
    new = np.cumsum(used) - 1
    return Patch(layer, vertices[used], new[faces], thickness[used], axes[used])
