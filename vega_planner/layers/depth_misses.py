# SPDX-License-Identifier: Apache-2.0
"""How far layers are off their depth: whether a grid was close enough for a part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vega_planner.datatypes import Layer
from vega_planner.layers.distance_field import DistanceField

#: Layers are off their depth if more than a share of all points is off by more than this
#: [mm], or any vertex or centre of a face by more than these.
OFF_MM, OFF_RATIO, MOST_VERTEX_MM, MOST_CENTRE_MM = 0.02, 0.01, 0.1, 0.25

#: Faces that are measured for that, at most.
MOST_MEASURED = 30000


def depth_misses(
    layers: Sequence[Layer], field: DistanceField, straight: bool
) -> tuple[float, int]:
    """Measure how far layers are off their depth.

    Ways inside the part are never shorter than straight ones; where depths are not straight
    only points that are too deep are known to be off.

    Args:
        layers: The envelope layers.
        field: Distances to S.
        straight: Whether depths are straight distances to S.

    Returns:
        Share of the vertices and face centres that are off, and how many aims are missed.
    """
    faces = sum(len(layer.faces) for layer in layers)
    step = 1 + faces // MOST_MEASURED
    at_vertices, at_centres = [np.zeros(1)], [np.zeros(1)]
    for layer in layers:
        centres = layer.vertices[layer.faces[::step]].mean(1)
        for points, found in ((layer.vertices[::step], at_vertices), (centres, at_centres)):
            off = field.distances(points) - layer.depth_mm
            found.append(np.abs(off) if straight else np.maximum(off, 0.0))
    vertices, centres = np.concatenate(at_vertices), np.concatenate(at_centres)
    share = float(np.mean(np.concatenate([vertices, centres]) > OFF_MM))
    missed = int(share > OFF_RATIO)
    missed += int(vertices.max() > MOST_VERTEX_MM) + int(centres.max() > MOST_CENTRE_MM)
    return share, missed
