# SPDX-License-Identifier: Apache-2.0
"""The last levels are found wherever they lie between the nodes of the grid."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.datatypes import Part
from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.settings import LayerSettings

from .shapes import Solid, base, part_of

T = 0.8
SETTINGS = LayerSettings(thickness_mm=T)


def shifted(part, shift):
    return Part("shifted", part.vertices + shift, part.faces, part.restrained)


@pytest.mark.parametrize("radius", [3.2, 3.95, 5.5, 8.8, 15.2])
def test_a_sphere_has_as_many_layers_as_fit_wherever_it_stands(radius):
    """Of a polyhedron in a ball: the deepest point is its centre, by symmetry."""
    part = part_of(Solid.sphere(radius, 48), stand=False)
    deepest = float(DistanceField.of_part(part).distances(np.zeros((1, 3)))[0])
    count = int((deepest - T / 2) / T) + 1
    assert deepest - (count - 0.5) * T > 0.25, "the last sphere is one that must be there"
    rng = np.random.default_rng(7)
    for shift in rng.uniform(0, 0.52, (4, 3)):
        stack = generate_layers(shifted(part, shift), SETTINGS)
        assert len(stack.layers) == count
        last = stack.layers[-1]
        distances = DistanceField.of_part(stack.part).distances(last.vertices)
        assert np.abs(distances - last.depth_mm).max() < 0.02


@pytest.mark.parametrize("radius", [5.5, 8.7])
def test_a_dome_ends_with_a_cap_on_its_base(radius):
    part = part_of(Solid.sphere(radius, 48).trim_by_plane((0, 0, 1), 0.0), base)
    deepest = float(DistanceField.of_part(part).distances(np.zeros((1, 3)))[0])
    stack = generate_layers(part, SETTINGS)
    assert len(stack.layers) == int((deepest - T / 2) / T) + 1
    for sheet in stack.sheets:
        assert sheet.vertices[:, 2].min() > -1e-6


def test_two_lobes_keep_both_their_summits():
    lobes = Solid.sphere(5.5, 48) + Solid.sphere(5.5, 48).translate((20.3, 0.2, 0.1))
    stack = generate_layers(part_of(lobes), SETTINGS)
    last = stack.layers[-1]
    assert last.index == 6
    assert last.vertices[:, 0].min() < 1 and last.vertices[:, 0].max() > 19
