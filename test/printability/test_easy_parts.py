# SPDX-License-Identifier: Apache-2.0
"""A false "not printable" is as bad as a collision: parts that must pass, and are clear."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vega_planner import Settings, load_settings, plan

from .easy_parts import EASY, draw
from .touching import Print, spread

PARTS = Path(__file__).resolve().parents[2] / "parts"

#: Rows of a toolpath that are looked at.
ROWS = 250


def touches(result, folder):
    tool = result.cell.tool
    printed = Print(
        result.write(folder / "out"),
        (tool.distance, tool.radius),
        result.cell.placement.plate_z_mm,
    )
    return printed.touches(spread(len(printed), ROWS))


@pytest.mark.parametrize("name", list(EASY))
def test_an_easy_part_is_fully_printable_and_nothing_is_touched(name, tmp_path):
    path, thickness = draw(name, tmp_path)
    result = plan(
        path,
        Settings().updated(
            {"part": {"brr": ["down"], "unit": "mm"}, "layers": {"thickness_mm": thickness}}
        ),
    )
    assert result.printability.status == "fully"
    assert result.collisions["colliding_waypoints"] == 0
    assert touches(result, tmp_path) == []


@pytest.mark.parametrize(
    "name, status",
    [("part2_clover", "fully"), ("part5_peanut", "conditionally")],
)
def test_a_shipped_part_touches_nothing_by_an_independent_check(name, status, tmp_path):
    path = PARTS / f"{name}.stl"
    result = plan(path, load_settings(path.with_suffix(".yaml")))
    assert result.printability.status == status
    assert result.collisions["colliding_waypoints"] == 0
    assert touches(result, tmp_path) == []


def test_the_independent_check_sees_a_tool_that_is_pushed_into_the_part(tmp_path):
    """The last pass, run with the nozzle laid over, ploughs through what is printed."""
    path, _ = draw("box", tmp_path)
    result = plan(path, Settings().updated({"part": {"brr": ["down"], "unit": "mm"}}))
    last = result.toolpaths.passes[-1]
    axes = np.tile([np.sin(1.5), 0.0, np.cos(1.5)], (len(last.points), 1))
    passes = (*result.toolpaths.passes[:-1], dataclasses.replace(last, axes=axes))
    laid_over = dataclasses.replace(result.toolpaths, passes=passes)
    found = touches(dataclasses.replace(result, toolpaths=laid_over), tmp_path)
    assert any(touch.what == "bead" and touch.depth_mm > 1.0 for touch in found)
