# SPDX-License-Identifier: Apache-2.0
"""Distances at the nodes of the grid against exact ones."""

import numpy as np
import pytest

from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.grid import sample_part
from vega_planner.layers.grid_kernels import INSIDE
from vega_planner.progress import silent

from .shapes import Solid, part_of


def plates(gap: float, count: int) -> Solid:
    """Plates 1.5 mm thick on top of each other, with gaps between them."""
    stack = Solid()
    for k in range(count):
        side = 16.0 - 2 * (k % 3)
        stack += Solid.cube((side, 12, 1.5)).translate((1.3 * k, 0.7, k * (1.5 + gap)))
    return stack


@pytest.mark.parametrize("gap", [0.02, 0.1, 0.25, 0.38])
@pytest.mark.parametrize("pieces", [1, 12])
def test_nodes_know_their_distance_on_both_sides_of_gaps_narrower_than_the_grid(gap, pieces):
    solid = plates(gap, 4).refine(pieces)
    part = part_of(solid)
    field = DistanceField.of_part(part)
    grid = sample_part(part, field, 0.52, silent)
    nodes = np.flatnonzero(grid.state == INSIDE)
    exact = field.distances(grid.points(nodes))
    assert np.abs(grid.distance[nodes] - exact).max() < 1e-3
