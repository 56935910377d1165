# SPDX-License-Identifier: Apache-2.0
"""Passes that stand in each other's way are cut and interleaved, and lose nothing by it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import trimesh

from vega_planner import Settings, plan
from vega_planner.assess.virtual_print import simulate
from vega_planner.ordering import order_patches
from vega_planner.printability import assess_printability
from vega_planner.printability.interleave import interleaved
from vega_planner.printability.material import EMPTY
from vega_planner.printability.repair import resolve_collisions
from vega_planner.progress import silent
from vega_planner.settings import PrintabilitySettings, ToolpathSettings
from vega_planner.splitting import split_layers
from vega_planner.toolpaths.coverage import deposited_volume
from vega_planner.toolpaths.lay import lay_toolpaths, plan_moves

from .envelopes import default_cell, dome
from .test_collisions import check, joined, line, wall
from .test_easy_parts import touches

THICKNESS = 0.8


def climbing(y, patch, rows=14, length=20.0):
    """A wall in one pass, back and forth, row on row."""
    ends = []
    for k in range(rows):
        side = 1 if k % 2 else -1
        z = 0.4 + 0.8 * k
        ends += [[side * length / 2, y, z], [-side * length / 2, y, z]]
    points = np.concatenate([np.linspace(a, b, 21)[:-1] for a, b in pairwise(ends)])
    points = np.concatenate([points, [ends[-1]]])
    bead = line([0, 0, 0], [1, 0, 0], patch=patch)
    count = len(points)
    return replace(
        bead, points=points, axes=np.tile(bead.axes[0], (count, 1)),
        width=np.full(count, 1.2), height=np.full(count, THICKNESS),
    )  # fmt: skip


def woven(passes):
    return interleaved(passes, default_cell(), EMPTY, THICKNESS, silent)


def test_walls_too_near_for_the_nozzle_rise_together_and_nothing_is_lost():
    """One after the other, the second wall collides with the first along its whole length."""
    walls = [climbing(0.0, 0), climbing(1.1, 1)]
    before = check(joined(walls))
    assert before.colliding > 200
    found = woven(walls)
    stack, cell, policy = dome(), default_cell(), PrintabilitySettings()
    assert check(joined(found.passes)).colliding < 0.2 * before.colliding
    clear = resolve_collisions(joined(found.passes), stack, cell, policy, silent)[1]
    assert clear.colliding == 0 and clear.left_out_ratio == 0
    assert found.blocked_ratio == 0 and sum(found.floating_mm2.values()) == 0
    laid = deposited_volume(found.passes)
    assert laid == pytest.approx(deposited_volume(walls), rel=0.01)
    for patch in (0, 1):  # every place a bead was laid is still laid, by its own patch
        points = np.concatenate([p.points for p in found.passes if p.patch == patch])
        old = walls[patch].points
        away = np.linalg.norm(old[:, None] - points[None], axis=2).min(1)
        assert away.max() < 1.3


def test_beads_listed_from_the_top_down_are_laid_from_the_bottom_up():
    found = woven(wall(12)[::-1])
    heights = [path.points[0, 2] for path in found.passes]
    assert heights == sorted(heights) and len(heights) == 12
    assert sum(found.floating_mm2.values()) == 0


def test_a_bead_in_the_air_floats_with_its_area():
    bead = line([-10, 0, 9.0], [10, 0, 9.0], patch=3)
    found = woven([*wall(4), bead])
    assert found.floating_mm2[3] == pytest.approx(20 * 1.2)
    assert found.floating_mm2[0] == 0


def test_shells_of_a_dome_keep_their_length_and_come_out_the_same_each_time():
    stack, cell = dome(), default_cell()
    policy = PrintabilitySettings()
    assessment = assess_printability(stack, cell, policy, silent)
    patches = split_layers(stack, assessment, cell, policy, silent)
    order = order_patches(patches, stack, cell, policy, silent, assessment)
    paths = lay_toolpaths(order.patches, stack, cell, ToolpathSettings())
    found = interleaved(paths.passes, cell, EMPTY, stack.thickness_mm, silent)
    for path in paths.passes:
        laid = [other for other in found.passes if other.patch == path.patch]
        assert sum(p.length_mm for p in laid) == pytest.approx(path.length_mm, rel=0.02)
    assert found.blocked_ratio == 0
    again = interleaved(paths.passes, cell, EMPTY, stack.thickness_mm, silent)
    for a, b in zip(found.passes, again.passes, strict=True):
        assert a.points.tobytes() == b.points.tobytes()
    assert plan_moves(found.passes, cell, silent)[1] == ()


@pytest.fixture(scope="module")
def leaning(tmp_path_factory):
    """Two balls side by side, one higher: each has to be printed past the other."""
    low = trimesh.creation.icosphere(3, 6.0)
    high = trimesh.creation.icosphere(3, 5.0)
    high.apply_translation([7.5, 0.0, 6.0])
    path = tmp_path_factory.mktemp("leaning") / "leaning.stl"
    trimesh.boolean.union([low, high]).export(path)
    return plan(path, Settings().updated({"part": {"brr": ["none"], "unit": "mm"}}))


def test_a_part_whose_patches_wait_for_each_other_is_filled_and_nothing_is_touched(
    leaning, tmp_path
):
    assert leaning.printability.status == "conditionally"
    assert leaning.collisions["colliding_waypoints"] == 0
    assert leaning.collisions["left_out_ratio"] < 0.005
    order = [path.patch for path in leaning.toolpaths.passes]
    assert order != sorted(order)  # patches alternate
    assert leaning.coverage.deposited_mm3 == pytest.approx(leaning.part.volume, rel=0.01)
    assert touches(leaning, tmp_path) == []


def test_no_shaft_stays_open_between_patches_that_wait_for_each_other(leaning):
    """Cut into bands, the same part lacked a tenth of its volume, open to the outside."""
    printed = simulate(
        leaning.toolpaths,
        leaning.part,
        voxel_mm=0.2,
        plate_z_mm=leaning.cell.placement.plate_z_mm,
        substrate=leaning.cell.substrate,
    )
    assert printed.fidelity.under_pct < 2.0
