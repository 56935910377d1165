# SPDX-License-Identifier: Apache-2.0
"""What sheets cover of a part: every sample within half the thickness of the nearest face."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vega_planner.datatypes import Layer, Part
from vega_planner.layers import generate_layers
from vega_planner.layers.coverage import AXES, Samples, measure_coverage, spread_samples
from vega_planner.layers.distance_field import DistanceField
from vega_planner.settings import LayerSettings

from .shapes import box


@pytest.fixture(scope="module")
def part() -> Part:
    return box(11.0, 9.0, 5.3)


@pytest.fixture(scope="module")
def samples(part: Part) -> Samples:
    return spread_samples(part)


def sheets_of(part: Part, share: float) -> tuple[Layer, ...]:
    """Layers thinner than they should be, thinnest at one end."""
    stack = generate_layers(part, LayerSettings())
    return tuple(
        replace(
            sheet,
            thickness=sheet.thickness * (share + 0.03 * (sheet.vertices[:, 0] - 5)),
            mitre=None,
        )
        for sheet in (*stack.layers, *stack.cores)
    )


def points_of(samples: Samples, nodes: np.ndarray) -> np.ndarray:
    steps = np.column_stack(np.unravel_index(nodes, samples.shape))
    return (samples.origin + samples.spacing * steps) @ AXES.T


def test_a_sample_is_open_where_it_is_beyond_half_the_thickness_of_the_nearest_face(part, samples):
    sheets = sheets_of(part, 0.8)
    points = points_of(samples, samples.nodes)
    covered = np.zeros(len(points), bool)
    for sheet in sheets:
        found = DistanceField(sheet.vertices, sheet.faces).nearest(points)
        covered |= found.distances < sheet.thickness[sheet.faces].mean(1)[found.faces] / 2
    coverage = measure_coverage(part, samples, sheets)
    expected = samples.nodes[~covered]
    assert 0.02 < len(expected) / len(points) < 0.5
    # faces of two thicknesses may be equally near
    assert len(np.setxor1d(coverage.open_nodes, expected)) < 1e-3 * len(points)
    assert coverage.uncovered == pytest.approx(len(coverage.open_nodes) / len(points))


def test_looking_only_at_what_was_left_open_tells_the_same_of_thicker_sheets(part, samples):
    thin = measure_coverage(part, samples, sheets_of(part, 0.8))
    thicker = sheets_of(part, 0.95)
    after = measure_coverage(part, samples, thicker, thin)
    anew = measure_coverage(part, samples, thicker)
    assert 0 < len(anew.open_nodes) < len(thin.open_nodes)
    assert np.array_equal(after.open_nodes, anew.open_nodes)
    assert (after.uncovered, after.overfill) == (anew.uncovered, anew.overfill)


def test_the_samples_about_a_place_are_those_within_a_distance_along_each_axis(part, samples):
    places = part.bounds[0] + np.array([[5.0, 4.0, 2.0], [8.0, 2.0, 5.2]])
    found = samples.about(places, 0.5)
    away = np.abs((points_of(samples, samples.nodes)[:, None] - places) @ AXES).max(2).min(1)
    inside = set(found.tolist())
    assert set(samples.nodes[away <= 0.5].tolist()) <= inside
    assert inside <= set(samples.nodes[away <= 0.5 + 1.5 * samples.spacing].tolist())
