# SPDX-License-Identifier: Apache-2.0
"""Flat slices of parts whose sections are known."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.layers import generate_layers
from vega_planner.settings import LayerSettings

from .shapes import Solid, dome, part_of

SETTINGS = LayerSettings(thickness_mm=0.5, engine="planar")


def test_slices_of_a_dome_are_discs():
    stack = generate_layers(dome(10, 256), SETTINGS)
    assert len(stack.layers) == 20
    for k, layer in enumerate(stack.layers):
        z = 0.25 + 0.5 * k
        assert layer.vertices[:, 2] == pytest.approx(z)
        assert layer.area == pytest.approx(np.pi * (100 - z**2), rel=0.006)
        assert layer.face_normals[:, 2].min() > 0.999


def test_holes_stay_open():
    tube = Solid.cylinder(5, 6, 6, 64) - Solid.cylinder(5, 3, 3, 64)
    layer = generate_layers(part_of(tube), SETTINGS).layers[3]
    assert layer.area == pytest.approx(np.pi * 27, rel=0.005)
    assert np.linalg.norm(layer.vertices[:, :2], axis=1).min() > 2.9


@pytest.mark.parametrize(("height", "count"), [(5.0, 10), (5.2, 10), (5.3, 11)])
def test_the_last_slice_is_made_if_its_middle_is_in_the_part(height, count):
    stack = generate_layers(part_of(Solid.cube((4, 4, height))), SETTINGS)
    assert len(stack.layers) == count
