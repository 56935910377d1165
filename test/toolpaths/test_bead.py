# SPDX-License-Identifier: Apache-2.0
"""The bead's section."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.toolpaths.bead import (
    fill_spacing,
    fill_width,
    lean,
    leaning_section,
    section_area,
)


def test_the_papers_bead_fills_at_1_03_mm():
    assert abs(fill_spacing(1.2, 0.8) - 1.0283) < 1e-4


def test_section_is_a_rectangle_and_a_circle():
    assert section_area(2.0, 0.5) == 1.5 * 0.5 + np.pi * 0.25**2
    assert abs(section_area(0.7, 0.7) - np.pi * 0.35**2) < 1e-15


@given(st.floats(0.3, 1.2), st.floats(0.0, 1.0))
@settings(deadline=None, derandomize=True)
def test_a_bead_deposits_what_its_strip_holds(height, share):
    nominal = fill_spacing(1.2, 0.8)
    cell = np.array([(0.7 + 0.6 * share) * nominal])
    width = fill_width(cell, np.array([height]), nominal)
    area = section_area(width, np.array([height]))
    assert width[0] >= height
    assert area[0] >= cell[0] * height - 1e-12
    if width[0] > height:
        assert abs(area[0] - cell[0] * height) < 1e-12


@given(st.floats(0.4, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
@settings(deadline=None, derandomize=True)
def test_a_leaning_bead_keeps_its_area_and_stands_out_least(height, more, sine):
    width = height + more
    w, h = leaning_section(np.array([width]), np.array([height]), np.array([sine]))
    area = section_area(width, height)
    assert w[0] >= h[0] - 1e-9 and h[0] >= height
    assert abs(section_area(w[0], h[0]) - area) < 1e-9
    heights = np.linspace(height, np.sqrt(area / (np.pi / 4)), 200)
    widths = area / heights + (1 - np.pi / 4) * heights
    reach = (widths - heights) / 2 * sine + heights / 2
    assert (w[0] - h[0]) / 2 * sine + h[0] / 2 <= reach.min() + 1e-4


def test_lean_is_measured_across_the_path_only():
    points = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    normals = np.tile([0.0, 0.0, 1.0], (5, 1))
    forward = np.tile([np.sin(0.4), 0.0, np.cos(0.4)], (5, 1))
    aside = np.tile([0.0, np.sin(0.4), np.cos(0.4)], (5, 1))
    assert np.abs(lean(points, forward, normals)).max() < 1e-12
    assert np.abs(lean(points, aside, normals) - np.sin(0.4)).max() < 1e-12
