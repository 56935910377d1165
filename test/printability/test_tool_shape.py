# SPDX-License-Identifier: Apache-2.0
"""The tool's samples and what the plate leaves of its tilt."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from .envelopes import default_cell
from vega_planner.printability.tool_shape import STEP_MM, ToolShape

TOOL = default_cell().tool


def surface(tip: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Dense points on the outside of the tool."""
    along = np.concatenate([np.linspace(0, TOOL.distance[-1], 1201), TOOL.distance])
    turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    side = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    ring = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
    radius = np.interp(along, TOOL.distance, TOOL.radius)
    return tip + along[:, None, None] * axis + radius[:, None, None] * ring


@settings(deadline=None, derandomize=True, max_examples=25)
@given(st.floats(0, 3.1), st.floats(0, 6.2), st.floats(-5, 30))
def test_lowest_point_of_the_tool_is_exact(tilt, turn, height):
    axis = np.array(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)]
    )
    tip = np.array([1.0, 2.0, height])
    low = ToolShape.of(TOOL).height_above(tip[None], axis[None])[0]
    dense = surface(tip, axis)[..., 2].min()
    assert low <= dense + 1e-9
    assert low >= dense - 2e-3


@settings(deadline=None, derandomize=True, max_examples=40)
@given(st.floats(0.3, 20))
def test_largest_tilt_touches_the_clearance_and_no_more(height):
    shape = ToolShape.of(TOOL)
    tilt = shape.largest_tilt(np.array([height]), 0.2)[0]
    axis = np.array([[np.sin(tilt), 0.0, np.cos(tilt)]])
    gap = shape.height_above(np.array([[0.0, 0.0, height]]), axis)[0]
    assert gap >= 0.2 - 1e-3
    steeper = tilt + np.radians(1.0)
    axis = np.array([[np.sin(steeper), 0.0, np.cos(steeper)]])
    assert shape.height_above(np.array([[0.0, 0.0, height]]), axis)[0] < 0.2


def test_a_horizontal_nozzle_at_the_plate_must_rise_by_more_than_15_degrees():
    assert np.degrees(ToolShape.of(TOOL).largest_tilt(np.array([0.8]), 0.2)[0]) < 75


def test_no_tilt_is_left_where_even_the_upright_tip_is_too_low():
    assert ToolShape.of(TOOL).largest_tilt(np.array([0.1]), 0.2)[0] < 0


def test_inscribed_balls_stay_inside_and_touch_the_outline():
    shape = ToolShape.of(TOOL, 2.0)
    dense = np.linspace(2.0, TOOL.distance[-1], 20001)
    outline = np.interp(dense, TOOL.distance, TOOL.radius)
    for index in range(8, len(shape.inscribed), 7):
        s = index * STEP_MM
        distance = np.hypot(dense - s, outline).min()
        ends = min(s - 2.0, TOOL.distance[-1] - s)
        assert abs(shape.inscribed[index] - min(distance, ends)) < 2e-3


def test_reach_inverts_the_growth_of_the_balls():
    shape = ToolShape.of(TOOL, 2.0)
    along = np.arange(len(shape.inscribed)) * STEP_MM
    for index, s in enumerate(shape.reach):
        assert (along + shape.inscribed)[along <= s].max() <= index * STEP_MM + 1e-9 or s == 0


def test_every_corner_that_turns_to_the_axis_is_a_rim():
    shape = ToolShape.of(TOOL, 2.0)
    assert shape.rim_at.tolist() == [2.0, 45.0, 120.0]
