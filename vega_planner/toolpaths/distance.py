# SPDX-License-Identifier: Apache-2.0
"""Distance fields on a patch: from its rim, from a guide curve, through space."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.toolpaths.distance_kernels import (
    FAR,
    march,
    start_at_rim,
    start_at_vertex,
    start_at_zero,
)
from vega_planner.toolpaths.surface import Surface


def from_rim(
    surface: Surface, carried: Floats | None = None, limit: float = math.inf
) -> tuple[Floats, Floats, Floats]:
    """Measure the geodesic distance from the rim; from the lowest point without one.

    Args:
        surface: The patch.
        carried: Values at the vertices, of which those at the rim are carried inwards
            along the shortest ways, shape (n, c).
        limit: Distances above it are not needed [mm].

    Returns:
        Distances [mm], shape (n,), their unit gradients, shape (n, 3), and what each
        vertex has from the place of the rim nearest to it, shape (n, c).
    """
    count = len(surface.vertices)
    d, g = np.full(count, FAR), np.zeros((count, 3))
    brought = np.zeros((count, 0)) if carried is None else carried.copy()
    fixed = np.zeros(count, np.bool_)
    rim = surface.rim_edges
    star = (surface.offsets, surface.star)
    if len(rim):
        start_at_rim(surface.vertices, surface.faces, *star, rim, d, g, brought, fixed)
    with_rim = np.zeros(surface.component_count, np.bool_)
    with_rim[surface.component[rim[:, 0]]] = True
    for piece in np.flatnonzero(~with_rim):
        members = np.flatnonzero(surface.component == piece)
        source = members[np.lexsort((members, surface.vertices[members, 2]))[0]]
        start_at_vertex(surface.vertices, surface.faces, *star, source, d, g, fixed)
    march(surface.vertices, surface.faces, *star, d, g, brought, fixed, limit)
    return d, g, brought


def from_guide(surface: Surface, guide: Floats) -> Floats:
    """Measure the signed geodesic distance from the zero line of a field.

    Args:
        surface: The patch.
        guide: Field at the vertices, both signs on every piece, shape (n,).

    Returns:
        Distances [mm], with the sign of the field, shape (n,).
    """
    count = len(surface.vertices)
    d, g = np.full(count, FAR), np.zeros((count, 3))
    fixed = np.zeros(count, np.bool_)
    side = np.where(guide < 0, -1.0, 1.0)
    off_zero = np.where(np.abs(guide) < 1e-9, 1e-9 * side, guide)
    start_at_zero(surface.vertices, surface.faces, off_zero, d, g, fixed)
    star, nothing = (surface.offsets, surface.star), np.zeros((count, 0))
    march(surface.vertices, surface.faces, *star, d, g, nothing, fixed, math.inf)
    return d * side


def through_space_from_rim(surface: Surface, spacing: float) -> Floats:
    """Measure the straight distance from the rim, not along the surface.

    Args:
        surface: The patch; pieces without a rim are measured from their lowest point.
        spacing: The rim is sampled ten times finer than this [mm].

    Returns:
        Distances [mm], shape (n,).
    """
    from scipy.spatial import cKDTree

    distance = np.empty(len(surface.vertices))
    rim = surface.rim_edges
    for piece in range(surface.component_count):
        members = np.flatnonzero(surface.component == piece)
        mine = rim[surface.component[rim[:, 0]] == piece]
        if len(mine):
            a, b = surface.vertices[mine[:, 0]], surface.vertices[mine[:, 1]]
            longest = float(np.linalg.norm(b - a, axis=1).max())
            w = np.linspace(0, 1, max(2, math.ceil(10 * longest / spacing)), endpoint=False)
            samples = (a[:, None] + w[:, None] * (b - a)[:, None]).reshape(-1, 3)
        else:
            samples = surface.vertices[members[[np.argmin(surface.vertices[members, 2])]]]
        distance[members] = cKDTree(samples).query(surface.vertices[members])[0]
    return distance
