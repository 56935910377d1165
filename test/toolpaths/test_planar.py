# SPDX-License-Identifier: Apache-2.0
"""The planar baseline against hand-made answers."""

from dataclasses import replace

import numpy as np
import pytest

from vega_planner.progress import silent
from vega_planner.settings import ToolpathSettings
from vega_planner.toolpaths import lay_toolpaths
from vega_planner.toolpaths.bead import fill_spacing
from vega_planner.toolpaths.coverage import deposited_volume, pass_gaps, uncovered_area

SQUARE = [(-10, -10), (10, -10), (10, 10), (-10, 10)]
ELL = [(0, 0), (30, 0), (30, 7.3), (9.1, 7.3), (9.1, 25), (0, 25)]
STRIP = [(0, 0), (20, 0), (20, 1.5), (0, 1.5)]
THREAD = [(0, 0), (20, 0), (20, 0.9), (0, 0.9)]
HOLED = [
    [(-12, -9), (12, -9), (12, 9), (-12, 9)],
    [(-3.3, -2), (-3.3, 2.4), (4, 2.4), (4, -2)],
]


def _lay(make, rings, **changes):
    patch = make.flat(rings)
    stack = make.stack([patch], "planar")
    done = lay_toolpaths((patch,), stack, make.cell(), ToolpathSettings(**changes), silent)
    return patch, done


def test_the_outer_side_of_the_first_wall_lies_on_the_outline(make):
    _, done = _lay(make, [SQUARE])
    corner = max(np.abs(path.points[:, :2]).max() for path in done.passes)
    assert abs(corner + 0.6 - 10) < 1e-9


@pytest.mark.parametrize("rings", [[SQUARE], [ELL], [STRIP], [THREAD], HOLED])
def test_walls_deposit_the_volume_of_the_layer(make, rings):
    patch, done = _lay(make, rings)
    assert abs(deposited_volume(done.passes) / (0.8 * patch.area) - 1) < 0.02


def test_a_strip_of_one_bead_gets_one_line(make):
    _, done = _lay(make, [THREAD])
    (path,) = done.passes
    assert not path.closed
    assert np.abs(path.points[:, 1] - 0.45).max() < 0.1


def test_a_flat_patch_whose_axes_are_off_by_the_noise_of_its_mesh_is_laid_as_a_flat_one(make):
    patch = make.flat(HOLED)
    rng = np.random.default_rng(1)
    axes = patch.tool_axes + rng.uniform(-0.006, 0.006, patch.tool_axes.shape)
    noisy = replace(patch, tool_axes=axes / np.linalg.norm(axes, axis=1, keepdims=True))
    done = [
        lay_toolpaths((flat,), make.stack([flat], "field"), make.cell(), ToolpathSettings())
        for flat in (patch, noisy)
    ]
    for one, other in zip(done[0].passes, done[1].passes, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        np.testing.assert_array_equal(one.axes, other.axes)


@pytest.mark.parametrize("angle", [0.0, 45.0])
def test_zigzag_lines_lie_in_the_wanted_direction(make, angle):
    patch, done = _lay(make, [SQUARE], pattern="zigzag", angle_deg=angle)
    step = np.concatenate([np.diff(path.points, axis=0) for path in done.passes])
    length = np.linalg.norm(step, axis=1)
    direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    along = length[np.abs(step @ direction) > 0.999 * length].sum()
    assert along > 0.7 * length.sum()
    assert abs(deposited_volume(done.passes) / (0.8 * patch.area) - 1) < 0.03


def test_parallel_lines_and_their_rim_cover_a_flat_patch_of_few_triangles(make):
    turn = np.linspace(0.0, 2 * np.pi, 120, endpoint=False)
    patch = make.flat([20.0 * np.column_stack([np.cos(turn), np.sin(turn)])])
    settings = ToolpathSettings(pattern="zigzag", skin_overlap_ratio=0.0)
    done = lay_toolpaths((patch,), make.stack([patch]), make.cell(), settings)
    spacing = fill_spacing(1.2, 0.8)
    gaps, _ = pass_gaps(done.passes, spacing)
    assert gaps.max() <= 1.1
    assert uncovered_area(patch, done.passes, 0.55 * spacing, 0.15) <= 0.005 * patch.area


def test_points_on_a_straight_outline_change_nothing(make):
    corners = np.array(ELL, dtype=float)
    after = np.roll(corners, -1, axis=0)
    part = np.linspace(0.0, 1.0, 40, endpoint=False)[:, None]
    fine = np.concatenate([a + part * (b - a) for a, b in zip(corners, after)])
    (_, few), (_, many) = _lay(make, [ELL]), _lay(make, [fine])
    assert len(few.passes) == len(many.passes)
    assert abs(few.path_length_mm - many.path_length_mm) < 1e-4 * few.path_length_mm


@pytest.mark.parametrize("neck", [0.9, 1.25])
def test_a_neck_between_two_discs_gets_one_line(make, neck):
    """Walls of both discs end where the neck is too narrow for two of them."""
    angle = np.arcsin(0.5 * neck / 6.0)
    turn = np.linspace(angle, 2 * np.pi - angle, 150)
    disc = 6.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    outline = np.vstack([disc - [10.0, 0.0], -disc + [10.0, 0.0]])
    patch, done = _lay(make, [outline])
    points = np.concatenate([path.points for path in done.passes])
    inside = np.abs(points[:, 0]) < 2.5
    assert inside.any()
    assert np.abs(points[inside, 1]).max() < 0.15
    assert abs(deposited_volume(done.passes) / (0.8 * patch.area) - 1) < 0.02
