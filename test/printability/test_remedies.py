# SPDX-License-Identifier: Apache-2.0
"""Remedies: what they promise is what happens when they are done."""

import re
from dataclasses import replace

import numpy as np
import pytest

from vega_planner.printability import assess_printability
from vega_planner.printability.remedies import access_remedy, reach_remedy, support_remedy
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.progress import silent
from vega_planner.robot.workcell import place
from vega_planner.settings import PrintabilitySettings

from .envelopes import default_cell, dome

SETTINGS = PrintabilitySettings()


def beside_the_middle(pose):
    layer = dome().layers[0]
    axes = layer.vertex_normals.copy()
    axes[:, 2] = np.maximum(axes[:, 2], 1.0)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return layer.vertices, axes, place(default_cell(), pose)


@pytest.mark.parametrize("pose", [(300.0, 0, 0, 0), (0, -320.0, 0, 30.0), (-310.0, 40.0, 0, 0)])
def test_a_move_that_is_proposed_makes_the_promised_share_reachable(pose):
    points, axes, cell = beside_the_middle(pose)
    text = reach_remedy(points, axes, cell, SETTINGS)
    promised, now = (int(word) for word in re.findall(r"(\d+)%", text))
    assert now == pytest.approx(100 * cell.reachable(points, axes).mean(), abs=3)
    at = re.search(r"--pose (\S+)\)", text)
    assert at and promised > now
    moved = place(cell, tuple(float(x) for x in at.group(1).split(",")))
    assert promised == pytest.approx(100 * moved.reachable(points, axes).mean(), abs=3)


def test_where_no_move_helps_that_is_said():
    points, axes, cell = beside_the_middle((5000.0, 0, 0, 0))
    assert "no move" in reach_remedy(points, axes, cell, SETTINGS)


def test_a_slimmer_tool_is_proposed_where_it_is_the_tool_s_width_that_touches():
    """A wall as far from the tool's axis as 0.7 of its radius 80 mm behind the tip."""
    cell = default_cell()
    axes = np.tile([0.0, 0.0, 1.0], (10, 1))

    def access(sheet, vertices, turned, tool, mm):
        return np.full(len(vertices), 0.7 * 12.0) - tool.radius.max()

    text = access_remedy([(0, np.arange(10), axes)], access, cell, SETTINGS)
    assert "40% slimmer" in text and "100% of it clear" in text
    slim = ToolShape.of(replace(cell.tool, radius=cell.tool.radius * 0.6))
    assert access(0, np.arange(10), axes, slim, 0.2).min() >= 0.2


def test_the_angle_an_overhang_needs_is_told():
    tilt = np.radians(90 + np.linspace(50, 60, 101))
    normals = np.column_stack([np.sin(tilt), np.zeros(101), np.cos(tilt)])
    side = np.tile([1.0, 0.0, 0.0], (101, 1))
    text = support_remedy(normals, side, False, SETTINGS)
    assert "max_overhang_deg 60" in text and "max_lean_deg" not in text.split(" instead")[0]
    flat = np.tile([0.0, 0.0, -1.0], (101, 1))
    assert "--brr down" in support_remedy(flat, side, True, SETTINGS)


def test_every_reason_of_a_part_out_of_reach_comes_with_a_figure():
    cell = place(default_cell(), (300.0, 0.0, 0.0, 0.0))
    report = assess_printability(dome(), cell, SETTINGS, silent).report
    assert report.reasons and report.unprintable_ratio > 0
    assert all("%" in reason.remedy for reason in report.reasons if "travel" in reason.code)
