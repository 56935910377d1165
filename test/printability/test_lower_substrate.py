# SPDX-License-Identifier: Apache-2.0
"""A substrate that stands in the way gives way to a lower one; one that does not stays."""

import numpy as np
import pytest
import trimesh

from vega_planner.printability import assess_printability
from vega_planner.printability.lower_substrate import with_lower_substrate
from vega_planner.progress import silent
from vega_planner.results import substrate_file
from vega_planner.results.substrate_file import planned_substrate, write_substrate
from vega_planner.robot.workcell import place
from vega_planner.settings import PrintabilitySettings, Settings
from vega_planner.substrate import Substrate, make_substrate, stand_on_substrate

from .envelopes import default_cell, ellipsoid

SETTINGS = PrintabilitySettings()


def test_a_substrate_over_the_part_gives_way_to_a_low_bowl():
    stack = ellipsoid(fine=3)
    roof = trimesh.creation.annulus(4.0, 17.0, 3.0)
    roof.apply_translation([0.0, 0.0, 23.0])
    tall = Substrate(np.array(roof.vertices), np.array(roof.faces), 24.5, 2.0)
    cell = place(default_cell(), (0.0, 0.0, 0.0, 0.0), lift_mm=2.0, substrate=tall)
    before = assess_printability(stack, cell, SETTINGS, silent, 1.2)
    assert before.report.unprintable_ratio > 0.05
    other, after = with_lower_substrate(stack, cell, SETTINGS, before, silent, 1.2)
    assert after.report.unprintable_ratio < 0.5 * before.report.unprintable_ratio
    assert other.substrate.vertices[:, 2].max() <= 0.4 * 24.5 + 1e-9
    assert other.placement.plate_z_mm == -other.substrate.floor_mm
    assert "print the substrate.stl of this result" in other.warnings[-1]


def test_a_substrate_that_is_not_in_the_way_stays():
    stack = ellipsoid(fine=3)
    cell = stand_on_substrate(default_cell(), stack.part)
    judged = assess_printability(stack, cell, SETTINGS, silent, 1.2)
    same, answer = with_lower_substrate(stack, cell, SETTINGS, judged, silent, 1.2)
    assert same is cell and answer is judged


def test_the_file_is_the_substrate_the_planner_chooses(tmp_path, monkeypatch):
    stack = ellipsoid(fine=3)
    usual = make_substrate(stack.part)
    lower = make_substrate(stack.part, height_mm=0.4 * usual.height_mm)
    planned = planned_substrate(stack.part, Settings())
    assert np.array_equal(planned.vertices, usual.vertices)
    monkeypatch.setattr(substrate_file, "planned_substrate", lambda *_: lower)
    path = write_substrate(stack.part, tmp_path / "low.stl")
    assert trimesh.load(path).bounds[1, 2] == pytest.approx(lower.vertices[:, 2].max(), abs=1e-4)
