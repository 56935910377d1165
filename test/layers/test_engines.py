# SPDX-License-Identifier: Apache-2.0
"""Both engines give the same layers where the equations mean the same."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.minkowski import facet_error_mm, minkowski_layers
from vega_planner.settings import LayerSettings

from .shapes import Solid, base, box, part_of

SEGMENTS = 16
T = 0.8


def wedge():
    points = [[0, 0, 0], [9, 0, 0], [9, 6, 0], [0, 6, 0], [0, 0, 5], [0, 6, 5]]
    return part_of(Solid.hull_points(np.array(points, float)), base)


def tetra():
    points = [[0, 0, 0], [11, 0, 0], [4, 10, 0], [5, 3, 9.0]]
    return part_of(Solid.hull_points(np.array(points)), base)


PARTS = {
    "box": lambda: box(9, 8, 5),
    "box in full": lambda: box(9, 8, 5, None),
    "wedge": wedge,
    "tetrahedron": tetra,
    "cone": lambda: part_of(Solid.cylinder(6, 4, 1, 8), base),
    "ledge": lambda: part_of(Solid.cube((6, 4, 2)) + Solid.cube((3, 4, 4.5)), base),
}


@pytest.mark.parametrize("name", PARTS)
def test_the_field_gives_the_layers_of_the_literal_process(name):
    part = PARTS[name]()
    settings = LayerSettings(thickness_mm=T, fill_core=False)
    field = generate_layers(part, settings).layers
    literal = minkowski_layers(part, settings, segments=SEGMENTS).layers
    assert len(field) > 1
    # A last piece smaller than a bead is left to the core.
    assert sum(layer.area for layer in literal[len(field) :]) < 2.7 * T**2
    assert len(field) <= len(literal)
    distances = []
    for a, b in zip(field, literal):
        for one, other in ((a, b), (b, a)):
            points = np.concatenate([one.vertices, one.vertices[one.faces].mean(1)])
            distances.append(DistanceField(other.vertices, other.faces).distances(points))
    facets = facet_error_mm(T / 2, SEGMENTS) + (len(field) - 1) * facet_error_mm(T, SEGMENTS)
    # Faceted balls err at concave places only.
    assert np.quantile(np.concatenate(distances), 0.99) < 0.03 + (name == "ledge") * facets
