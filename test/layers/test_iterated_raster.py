# SPDX-License-Identifier: Apache-2.0
"""As many layers as the paper's iteration takes on a fine raster, behind hollows as well.

The reference is the iteration itself, on cells instead of surfaces: what lies within a
ball of what is gone goes next, the restraint region being no source. Its distances come
from scipy, none of them from the engine.
"""

from __future__ import annotations

import manifold3d
import numpy as np
from scipy.ndimage import distance_transform_edt

from test.layers.shapes import part_of, slotted
from vega_planner.layers import generate_layers
from vega_planner.settings import LayerSettings

T = 0.8
CELL = 0.1


def iterated_layers(inside: np.ndarray, sources: np.ndarray, cell: float) -> int:
    """Count the layers of the paper's iteration.

    Args:
        inside: Cells of the part.
        sources: Cells beyond S.
        cell: Size of a cell [mm]; t / 2 should be a multiple.
    """
    left, gone = inside.copy(), sources.copy()
    reach = T / 2
    layers = 0
    while True:
        # From the middle of a cell to the side of the next that is gone.
        distance = distance_transform_edt(~gone) * cell - cell / 2
        taken = left & (distance < reach)
        left &= ~taken
        # What has been eaten into is a source, what is left of the region is none.
        gone = taken if taken.any() else gone
        if not left.any():
            return layers
        layers += 1
        reach = T


def middles(low: float, high: float, cell: float) -> np.ndarray:
    return np.arange(low, high - 1e-9, cell) + cell / 2


def layers_of(part) -> int:
    return len(generate_layers(part, LayerSettings(thickness_mm=T, fill_core=False)).layers)


def test_slotted_block_has_the_layers_of_the_iteration():
    part = slotted(2.0)
    y, z = np.meshgrid(middles(-0.2, 24, CELL), middles(0, 20, CELL), indexing="ij")
    inside = (y > 0) & ~((np.abs(y - 12) < 1) & (z > 6))
    assert layers_of(part) == iterated_layers(inside, y < 0, CELL)


def test_hollow_dome_has_the_layers_of_the_iteration():
    ball = manifold3d.Manifold.sphere
    solid = (ball(15, 96) - ball(9, 96)).trim_by_plane((0, 0, 1), 0)
    part = part_of(
        solid,
        lambda n, c: (np.linalg.norm(c, axis=1) < 9.1) | ((n[:, 2] < -0.9) & (c[:, 2] < 1e-6)),
    )
    # All sets are round about z, so the plane through the axis tells all distances.
    x, z = np.meshgrid(middles(-16, 16, CELL), middles(0, 16, CELL), indexing="ij")
    radius = np.hypot(x, z)
    assert layers_of(part) == iterated_layers((radius < 15) & (radius > 9), radius > 15, CELL)


def test_box_on_a_curved_cap_has_the_layers_of_the_iteration():
    solid = manifold3d.Manifold.cube((40, 30, 15)) - manifold3d.Manifold.sphere(40, 160).translate(
        (20, 15, -34)
    )
    part = part_of(
        solid,
        lambda n, c: (
            (np.linalg.norm(c - (20, 15, -34), axis=1) < 40.01)
            | ((n[:, 2] < -0.99) & (c[:, 2] < 1e-6))
        ),
    )
    # A quarter; the other three are its mirror images.
    cell = 0.2
    x, y, z = np.meshgrid(
        middles(-0.4, 20, cell), middles(-0.4, 15, cell), middles(0, 15.4, cell), indexing="ij"
    )
    box = (x > 0) & (y > 0) & (z < 15)
    cap = (x - 20) ** 2 + (y - 15) ** 2 + (z + 34) ** 2 < 40**2
    assert layers_of(part) == iterated_layers(box & ~cap, ~box, cell)
