# SPDX-License-Identifier: Apache-2.0
"""The final check finds what is planted, tells where, and signs what it saw."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from vega_planner.datatypes import (
    PrintabilityReport,
    PrintTrajectory,
    Reason,
    Toolpath,
    ToolpathSet,
    Travel,
)
from vega_planner.printability.certificate import certificate
from vega_planner.printability.collisions import check_toolpaths, with_check
from vega_planner.printability.leave_out import leave_out, leave_out_everything
from vega_planner.printability.repair import resolve_collisions
from vega_planner.printability.robot_body import BodyCheck, BodyHit, with_body
from vega_planner.progress import silent
from vega_planner.settings import PrintabilitySettings, Settings
from vega_planner.toolpaths.coverage import deposited_volume

from .envelopes import default_cell, dome

SETTINGS = PrintabilitySettings()
UP = np.array([0.0, 0.0, 1.0])


def line(start, end, axis=UP, patch=0) -> Toolpath:
    points = np.linspace(start, end, 41)
    axes = np.tile(np.asarray(axis) / np.linalg.norm(axis), (41, 1))
    return Toolpath(points, axes, np.full(41, 1.2), np.full(41, 0.8), patch, 0)


def hop(start, end, high=60.0) -> Travel:
    corners = [start, [*start[:2], high], [*end[:2], high], end]
    legs = [np.linspace(a, b, 30) for a, b in pairwise(corners)]
    points = np.concatenate(legs)
    return Travel(points, np.tile(UP, (len(points), 1)))


def joined(passes, high=60.0) -> ToolpathSet:
    ends = [np.array([0.0, 0.0, 60.0])]
    moves = []
    for path in passes:
        moves.append(hop(ends[-1], path.points[0], high if len(moves) else 60.0))
        ends.append(path.points[-1])
    moves.append(hop(ends[-1], np.array([0.0, 0.0, 60.0])))
    return ToolpathSet(tuple(passes), tuple(moves))


def wall(height: int, y: float = 0.0) -> list[Toolpath]:
    return [line([-10, y, 0.4 + 0.8 * k], [10, y, 0.4 + 0.8 * k]) for k in range(height)]


def check(paths):
    return check_toolpaths(paths, dome(), default_cell(), silent)


def test_a_wall_laid_from_the_bottom_up_is_clear():
    found = check(joined(wall(12)))
    assert found.colliding == 0
    assert found.checked == 12 * 41 + 13 * 90


def test_a_bead_beside_a_finished_wall_collides_and_not_before_it_is_there():
    passes = [*wall(20), line([-10, 1.3, 0.4], [10, 1.3, 0.4], patch=1)]
    found = check(joined(passes))
    printing = found.path == 20
    assert printing.sum() > 30
    assert set(found.path[found.path >= 0]) == {20}
    assert set(found.obstacle) == {"printed_part"}
    assert 0.2 < found.depth_mm.max() < 2.0
    first = [line([-10, 1.3, 0.4], [10, 1.3, 0.4], patch=1), *wall(20)]
    assert check(joined(first)).colliding == 0


def test_what_is_laid_in_the_same_patch_counts_from_when_it_is_there():
    low_last = [*wall(20), line([-10, 1.3, 0.4], [10, 1.3, 0.4], patch=0)]
    assert (check(joined(low_last)).path == 20).sum() > 30


def test_a_tool_tilted_into_the_plate_is_found_exactly():
    axis = [0.0, np.sin(np.radians(60)), np.cos(np.radians(60))]
    for height, hits in ((0.50, 41), (0.60, 0)):
        found = check(joined([line([-10, 0, height], [10, 0, height], axis)]))
        assert (found.path == 0).sum() == hits  # 0.65 sin 60 deg = 0.563
        assert set(found.obstacle) <= {"plate"}


def test_travel_through_a_wall_is_found():
    passes = [*wall(20), line([0, 12, 0.4], [10, 12, 0.4], patch=1)]
    low = list(joined(passes).travels)
    start, end = passes[-2].points[-1], passes[-1].points[0]
    through = np.linspace([-10.0, -12, 8], [10.0, 12, 8], 60)
    points = np.concatenate([[start], through, [end]])
    low[20] = Travel(points, np.tile(UP, (len(points), 1)))
    found = check(ToolpathSet(tuple(passes), tuple(low)))
    assert (found.path == -21).sum() > 5


def test_turning_the_nozzle_resolves_a_lean_into_the_wall():
    lean = [0.0, -np.sin(np.radians(30)), np.cos(np.radians(30))]
    passes = [*wall(10), line([-8, 4.0, 0.4], [8, 4.0, 0.4], lean, patch=1)]
    paths = joined(passes)
    assert check(paths).colliding > 20
    fixed, found = resolve_collisions(paths, dome(), default_cell(), SETTINGS, silent)
    assert found.colliding == 0
    assert check(fixed).colliding == 0
    for old, new in zip(paths.passes[:10], fixed.passes[:10]):
        assert old.axes.tobytes() == new.axes.tobytes()
    for travel, path in zip(fixed.travels, fixed.passes):
        assert np.allclose(travel.axes[-1], path.axes[0])
        assert np.allclose(travel.points[-1], path.points[0])


def test_the_paper_s_policy_is_checked_and_left_alone():
    lean = [0.0, -np.sin(np.radians(30)), np.cos(np.radians(30))]
    paths = joined([*wall(10), line([-8, 4.0, 0.4], [8, 4.0, 0.4], lean, patch=1)])
    normal = replace(SETTINGS, orientation="normal")
    same, found = resolve_collisions(paths, dome(), default_cell(), normal, silent)
    assert same is paths and found.colliding > 20


@pytest.fixture
def plan():
    paths = joined(wall(3))
    motion = PrintTrajectory(
        ("x", "y"), np.array([0.0, 1.0]), np.zeros((2, 2)), np.zeros((2, 2)),
        np.zeros(2, bool), np.array([-1, 0]), np.eye(4),
    )  # fmt: skip
    return dome().part, Settings(), default_cell(), paths, motion, check(paths), BodyCheck()


def test_equal_plans_have_equal_certificates(plan):
    assert certificate(*plan) == certificate(*plan)
    assert certificate(*plan)["collision_free"] is True


def test_a_touching_link_takes_the_certificate_and_the_status_like_a_colliding_nozzle(plan):
    hit = BodyHit("arm", "plate", 3.0, (1.0, 2.0, -1.0), 7)
    touching = BodyCheck((hit,), checked=20, touching=7)
    proof = certificate(*plan[:-1], touching)
    assert proof["collision_free"] is False
    assert proof["check"]["touching_samples"] == 7
    assert proof["check"]["touching_links"] == ["arm: plate"]
    good = PrintabilityReport("fully", 1.0, 1.0, 1.0)
    assert with_body(good, BodyCheck()) is good
    judged = with_body(good, touching)
    assert judged.status == "not"
    assert judged.reasons[-1].code == "robot_body"
    for word in ("'arm'", "plate", "--pose", "max_tilt_deg"):
        assert word in judged.reasons[-1].remedy


def test_every_input_shows_in_the_certificate(plan):
    part, settings, cell, paths, motion, *outcome = plan
    seen = certificate(*plan)
    moved = replace(part, vertices=part.vertices + np.array([0, 0, 1e-9]))
    other = replace(paths, passes=paths.passes[:2], travels=paths.travels[:3])
    later = replace(motion, times=motion.times + 1e-12 + [0, 1e-9])
    tool = replace(cell.tool, radius=cell.tool.radius * 1.01)
    changed = {
        "part": certificate(moved, settings, cell, paths, motion, *outcome),
        "settings": certificate(
            part, settings.updated({"seed": 1}), cell, paths, motion, *outcome
        ),
        "tool": certificate(part, settings, replace(cell, tool=tool), paths, motion, *outcome),
        "toolpath": certificate(part, settings, cell, other, motion, *outcome),
        "trajectory": certificate(part, settings, cell, paths, later, *outcome),
    }
    for name, proof in changed.items():
        differ = {k for k in seen["sha256"] if seen["sha256"][k] != proof["sha256"][k]}
        assert differ - {"job"} == {name}


def test_a_plan_that_collides_is_not_called_printable():
    good = PrintabilityReport("fully", 1.0, 1.0, 1.0)
    assert with_check(good, check(joined(wall(4)))).status == good.status
    seen = Reason("printed_part", 2, 5.0, (0.0, 0.0, 1.0), "split")
    guessed = replace(seen, layer=3)
    told = replace(good, reasons=(seen, guessed))
    assert with_check(told, check(joined(wall(4))), [seen]).reasons == (seen,)
    bad = [*wall(20), line([-10, 1.3, 0.4], [10, 1.3, 0.4], patch=1)]
    report = with_check(good, check(joined(bad)))
    assert report.status == "not"
    assert report.reasons[0].code == "printed_part"
    assert "waypoints collide" in report.reasons[0].remedy


def test_a_move_through_a_wall_takes_a_way_over_it():
    sides = [line([-10, -12, 0.4], [10, -12, 0.4], patch=1), line([10, 12, 0.4], [-10, 12, 0.4])]
    paths = joined([*wall(20), *sides], high=5.0)
    assert check(paths).colliding > 0
    cleared, found = resolve_collisions(paths, dome(), default_cell(), SETTINGS, silent)
    assert found.colliding == 0 and found.checked == check(cleared).checked
    assert all(a is b for a, b in zip(cleared.passes, paths.passes))
    for before, move, after in zip(cleared.passes, cleared.travels[1:], cleared.passes[1:]):
        np.testing.assert_array_equal(move.points[[0, -1]], [before.points[-1], after.points[0]])
        np.testing.assert_array_equal(move.axes[[0, -1]], [before.axes[-1], after.axes[0]])


def test_next_to_nothing_that_cannot_be_laid_is_left_out_and_told():
    part = dome().part
    rows = [wall(12, y) for y in (-2.4, -1.2, 0.0, 1.2, 2.4)]
    block = [bead for level in zip(*rows) for bead in level]
    short = line([-0.4, 0.0, 3.0], [0.4, 0.0, 3.0], patch=1)  # inside the finished block
    paths = joined([*block, short])
    cleared, found = resolve_collisions(paths, dome(), default_cell(), SETTINGS, silent)
    assert found.colliding == 0 and check(cleared).colliding == 0
    lost = deposited_volume(paths.passes) - deposited_volume(cleared.passes)
    assert 0 < lost <= 0.001 * part.volume
    assert any("left out" in warning for warning in cleared.warnings)
    long = joined([*block, line([-9, 0.0, 3.0], [9, 0.0, 3.0], patch=1)])
    assert leave_out(long, check(long), part) is None


def test_what_is_too_much_to_leave_out_is_laid_in_bands_before_it_is_built_in():
    rows = [wall(12, y) for y in (-2.4, -1.2, 0.0, 1.2, 2.4)]
    block = [bead for level in zip(*rows) for bead in level]
    long = joined([*block, line([-9, 0.0, 3.0], [9, 0.0, 3.0], patch=1)])
    assert check(long).colliding > 0
    banded, found = resolve_collisions(long, dome(), default_cell(), SETTINGS, silent)
    assert found.colliding == 0 and check(banded).colliding == 0
    assert deposited_volume(banded.passes) == pytest.approx(deposited_volume(long.passes))


def test_what_collides_goes_in_the_end_however_much_it_is_and_counts_in_the_status():
    part = dome().part
    rows = [wall(12, y) for y in (-2.4, -1.2, 0.0, 1.2, 2.4)]
    block = [bead for level in zip(*rows) for bead in level]
    long = joined([*block, line([-9, 0.0, 3.0], [9, 0.0, 3.0], patch=1)])

    def settle(paths, anew):
        again = joined(paths.passes)
        return again, check(again)

    less, found = leave_out_everything(long, check(long), part, settle)
    assert found.colliding == 0
    assert any("left out" in warning for warning in less.warnings)
    good = PrintabilityReport("fully", 1.0, 1.0, 1.0)
    for ratio, status in ((0.0005, "fully"), (0.005, "conditionally"), (0.03, "not")):
        assert with_check(good, replace(found, left_out_ratio=ratio)).status == status
    for ratio, status in ((0.009, "conditionally"), (0.011, "not")):  # one adds to the other
        lost = replace(good, status="conditionally", unprintable_ratio=0.01)
        assert with_check(lost, replace(found, left_out_ratio=ratio)).status == status
