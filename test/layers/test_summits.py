# SPDX-License-Identifier: Apache-2.0
"""The last levels are found, or left out, wherever they lie between the nodes of the grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.part import load_part
from vega_planner.part.topology import connected_pieces
from vega_planner.progress import silent
from vega_planner.settings import LayerSettings, PartSettings

from .shapes import Solid, base, part_of

SETTINGS = LayerSettings(thickness_mm=0.8)


def stacks_on_shifted_grids(solid, restrain=None):
    """A small cube beside the part sets where the grid begins."""
    for shift in (0.0, 0.11, 0.23, 0.31, 0.44):
        corner = Solid.cube((1.5, 1.5, 1.5)).translate((-14 - shift, -14 - 0.7 * shift, 0))
        raised = corner.translate((0, 0, solid.bounding_box()[2] - 0.6 * shift))
        beside = raised if restrain is None else corner
        yield generate_layers(part_of(solid + beside, restrain, stand=False), SETTINGS)


@pytest.mark.parametrize(("radius", "layers"), [(6.45, 8), (6.2, 7), (6.0, 7)])
def test_a_ball_has_as_many_layers_wherever_the_grid_stands(radius, layers):
    """The last level counts where it is wider than half a millimetre, 2 (R - r) > 0.53."""
    areas = []
    for stack in stacks_on_shifted_grids(Solid.sphere(radius, 64)):
        assert len(stack.layers) == layers
        last = stack.layers[-1]
        distances = DistanceField.of_part(stack.part).distances(last.vertices)
        assert np.abs(distances - last.depth_mm).max() < 0.02
        areas.append(last.area)
    assert max(areas) < 1.25 * min(areas)


def test_a_dome_has_as_many_layers_wherever_the_grid_stands():
    half = Solid.sphere(6.45, 64).trim_by_plane((0, 0, 1), 0.0)
    for stack in stacks_on_shifted_grids(half, base):
        assert len(stack.layers) == 8
        last = stack.layers[-1]
        assert last.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
        reach = 6.45 - last.depth_mm
        assert last.area == pytest.approx(2 * np.pi * reach**2, rel=0.25)


def test_a_last_piece_that_the_grid_has_seen_in_part_is_not_laid_twice():
    """The grid meets this dome's last level at nodes beside the summit only."""
    mesh = Path(__file__).parents[2] / "parts" / "part1_dome.stl"
    part = load_part(mesh, PartSettings(brr=("down",)), silent)
    last = generate_layers(part, SETTINGS).layers[-1]
    assert connected_pieces(len(last.vertices), last.faces)[1] == 1
