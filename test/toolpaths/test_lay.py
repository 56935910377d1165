# SPDX-License-Identifier: Apache-2.0
"""Passes and moves as a whole: coverage, volume, plate, travel, order."""

from dataclasses import replace

import numpy as np
import pytest

from vega_planner.datatypes import Toolpath
from vega_planner.errors import Cancelled
from vega_planner.progress import silent
from vega_planner.settings import ToolpathSettings
from vega_planner.toolpaths import lay_toolpaths
from vega_planner.toolpaths.bead import fill_spacing
from vega_planner.toolpaths.coverage import (
    deposited_volume,
    measure_coverage,
    pass_gaps,
    surface_samples,
    uncovered_area,
    volume_to_fill,
)
from vega_planner.toolpaths.lay import CHORD_MM, STEP_MM

SPACING = fill_spacing(1.2, 0.8)
PLAIN = ToolpathSettings(skin_overlap_ratio=0.0)


def _lay(make, patches, settings=PLAIN, plate=0.0, engine="field"):
    return lay_toolpaths(
        tuple(patches), make.stack(patches, engine), make.cell(plate), settings, silent
    )


def _weighted_quantile(values, weights, share):
    order = np.argsort(values)
    sums = np.cumsum(weights[order])
    return values[order][np.searchsorted(sums, share * sums[-1])]


@pytest.mark.parametrize("degrees", [45.0, 60.0, 70.0])
def test_loops_on_a_dome_keep_their_distance_and_leave_nothing_bare(make, degrees):
    patch = make.dome(30.0, degrees)
    done = _lay(make, [patch])
    gaps, lengths = pass_gaps(done.passes, SPACING)
    assert _weighted_quantile(gaps, lengths, 0.99) <= 1.02
    assert gaps.max() <= 1.1
    bare = uncovered_area(patch, done.passes, 0.55 * SPACING, 0.15)
    assert bare <= 0.005 * patch.area
    assert len(done.passes) == 1
    assert abs(deposited_volume(done.passes) / volume_to_fill(patch) - 1) < 0.01


@pytest.mark.parametrize("pattern", ["contour", "zigzag", "spiral"])
def test_every_pattern_covers_a_wavy_layer(make, pattern):
    patch = make.wavy()
    done = _lay(make, [patch], replace(PLAIN, pattern=pattern))
    bare = uncovered_area(patch, done.passes, 0.55 * SPACING, 0.15)
    assert bare <= 0.005 * patch.area
    gaps, lengths = pass_gaps(done.passes, SPACING)
    assert _weighted_quantile(gaps, lengths, 0.99) <= 1.02
    assert gaps.max() <= 1.1
    assert abs(deposited_volume(done.passes) / volume_to_fill(patch) - 1) < 0.02


def test_parallel_lines_and_their_rim_are_one_pass_on_a_dome(make):
    patch = make.dome(30.0, 70.0)
    done = _lay(make, [patch], replace(PLAIN, pattern="zigzag"))
    assert len(done.passes) == 1
    gaps, lengths = pass_gaps(done.passes, SPACING)
    assert _weighted_quantile(gaps, lengths, 0.99) <= 1.02
    assert gaps.max() <= 1.1


@pytest.mark.parametrize(
    ("degrees", "angle"), [(45.0, 0.0), (60.0, 0.0), (60.0, 30.0), (55.0, 45.0)]
)
def test_parallel_lines_leave_no_hole_where_they_turn_at_the_rim(make, degrees, angle):
    """No circle wider than a gap may be fits between the passes inside the rim's loop."""
    from scipy.spatial import cKDTree

    patch = make.dome(30.0, degrees)
    done = _lay(make, [patch], replace(PLAIN, pattern="zigzag", angle_deg=angle))
    gaps, lengths = pass_gaps(done.passes, SPACING)
    assert _weighted_quantile(gaps, lengths, 0.99) <= 1.02
    assert gaps.max() <= 1.1
    points, _ = surface_samples(patch, 0.25)
    inside = points[points[:, 2] > patch.vertices[:, 2].min() + SPACING]
    laid = np.concatenate(
        [
            (1 - w) * path.points[:-1] + w * path.points[1:]
            for path in done.passes
            for w in np.arange(10) / 10
        ]
    )
    distance, _ = cKDTree(laid).query(inside)
    assert distance.max() <= 0.56 * SPACING


@pytest.mark.parametrize("angle", [0.0, 30.0])
def test_parallel_lines_keep_their_distance_on_a_wavy_disc(make, angle):
    patch = make.wavy_disc()
    done = _lay(make, [patch], replace(PLAIN, pattern="zigzag", angle_deg=angle))
    gaps, lengths = pass_gaps(done.passes, SPACING)
    assert _weighted_quantile(gaps, lengths, 0.99) <= 1.02
    assert gaps.max() <= 1.1
    assert uncovered_area(patch, done.passes, 0.55 * SPACING, 0.15) <= 0.001 * patch.area


def test_corners_of_a_rim_that_lines_cross_askew_are_filled(make):
    patch = make.wavy()
    done = _lay(make, [patch], replace(PLAIN, pattern="zigzag", angle_deg=45.0))
    gaps, _ = pass_gaps(done.passes, SPACING)
    assert gaps.max() <= 1.1
    assert uncovered_area(patch, done.passes, 0.55 * SPACING, 0.15) <= 0.001 * patch.area
    assert abs(deposited_volume(done.passes) / volume_to_fill(patch) - 1) < 0.01


def test_a_gap_is_as_wide_as_what_no_pass_covers(make):
    across = np.linspace(0.0, 20.0, 81)

    def line(y, first=0, last=81):
        points = np.column_stack([across, np.full(81, y), np.zeros(81)])[first:last]
        count = len(points)
        upright = np.tile([0.0, 0.0, 1.0], (count, 1))
        return Toolpath(points, upright, np.full(count, 1.2), np.full(count, 0.8), 0, 0)

    gaps, _ = pass_gaps([line(0.0), line(1.5)], 1.0)
    np.testing.assert_allclose(gaps, 1.5)
    # a pass between them that ends half way leaves the gap open beside its end only
    gaps, lengths = pass_gaps([line(0.0), line(1.5), line(0.75, 0, 41)], 1.0)
    assert gaps.max() == pytest.approx(1.5) and gaps.min() == pytest.approx(0.75, abs=0.06)
    assert lengths[gaps > 1.0].sum() == pytest.approx(20.0, abs=1.1)


@pytest.mark.parametrize("pattern", ["contour", "zigzag"])
def test_euclidean_spacing_leaves_gaps_that_geodesic_spacing_does_not(make, pattern):
    patch = make.dome(30.0, 70.0)
    bare = {}
    for spacing in ("geodesic", "euclidean"):
        done = _lay(make, [patch], replace(PLAIN, pattern=pattern, spacing=spacing))
        bare[spacing] = uncovered_area(patch, done.passes, 0.55 * SPACING, 0.15)
    assert bare["euclidean"] > 3 * bare["geodesic"]


def test_spiral_is_one_line_that_fills_the_same_volume(make):
    patch = make.dome(30.0, 60.0)
    done = _lay(make, [patch], replace(PLAIN, pattern="spiral"), plate=-50.0)
    assert len(done.passes) == 1 and not done.warnings
    assert abs(deposited_volume(done.passes) / volume_to_fill(patch) - 1) < 0.01


def test_loops_alternate_so_that_the_nozzle_never_winds_up(make):
    patch = make.dome(30.0, 60.0, 8000)
    (path,) = _lay(make, [patch]).passes
    turn = np.unwrap(np.arctan2(path.points[:, 1], path.points[:, 0]))
    near_pole = np.hypot(path.points[:, 0], path.points[:, 1]) < 2
    assert np.ptp(turn[~near_pole]) < 2.2 * np.pi


@pytest.mark.parametrize("degrees", [40.0, 60.0, 90.0])
def test_no_bead_goes_through_the_plate(make, degrees):
    patch = make.dome(20.0, degrees, 12000, max_tilt=90.0)
    (path,) = _lay(make, [patch]).passes
    along = np.gradient(path.points, axis=0)
    across = np.cross(path.axes, along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    flat = 0.5 * (path.width - path.height) * np.abs(across[:, 2])
    around = 0.5 * path.height * np.hypot(across[:, 2], path.axes[:, 2])
    lowest = path.points[:, 2] - flat - around
    assert np.quantile(lowest, 0.005) > -0.03
    assert lowest.min() < 0.1  # it touches the plate


def test_points_stay_on_the_surface_and_near_each_other(make):
    patch = make.dome(30.0, 60.0)
    (path,) = _lay(make, [patch]).passes
    centre = np.array([0.0, 0.0, -15.0])
    middle = 0.5 * (path.points[1:] + path.points[:-1])
    off = np.abs(np.linalg.norm(middle - centre, axis=1) - 30.0)
    sagitta = (patch.area / len(patch.faces)) * 2.4 / (8 * 30.0)  # of the mesh itself
    assert off.max() < CHORD_MM + 2 * sagitta
    assert np.linalg.norm(np.diff(path.points, axis=0), axis=1).max() <= STEP_MM + 1e-9
    turn = np.einsum("ij,ij->i", path.axes[1:], path.axes[:-1])
    assert np.degrees(np.arccos(np.clip(turn, -1, 1))).max() < 4.0


def test_travel_joins_the_passes_and_starts_back_along_the_nozzle(make):
    patches = make.nest(count=4)
    done = _lay(make, patches)
    assert len(done.travels) == len(done.passes) + 1
    for path, move in zip(done.passes, done.travels[1:]):
        assert np.abs(move.points[0] - path.points[-1]).max() < 1e-9
        back = move.points[1] - move.points[0]
        assert back @ path.axes[-1] > 0.999 * np.linalg.norm(back)
    for path, move in zip(done.passes, done.travels):
        assert np.abs(move.points[-1] - path.points[0]).max() < 1e-9
        come = move.points[-2] - move.points[-1]
        assert come @ path.axes[0] > 0.999 * np.linalg.norm(come)
    assert done.travels[0].points[0, 2] > 20 and done.travels[-1].points[-1, 2] > 20


def test_the_tool_keeps_clear_of_what_is_printed_while_it_travels(make):
    patches = make.nest(count=5)
    cell = make.cell()
    done = _lay(make, patches)
    printed = np.zeros((0, 3))
    for before, move in zip(done.passes, done.travels[1:-1]):
        printed = np.concatenate([printed, before.points])
        for point, axis in zip(move.points, move.axes):
            away = np.linalg.norm(point - before.points[-1])
            if min(away, np.linalg.norm(point - move.points[-1])) < 2.9:
                continue  # in the column that the nozzle has just left, or is to enter
            rest = printed - point
            behind = rest @ axis
            aside = np.linalg.norm(rest - behind[:, None] * axis, axis=1)
            body = np.interp(behind, cell.tool.distance, cell.tool.radius, left=0.0, right=0.0)
            assert (aside - body).min() > 0.0


def test_a_nest_of_shells_is_printed_with_one_pass_each_and_little_travel(make):
    patches = make.nest(count=6)
    done = _lay(make, patches)
    assert len(done.passes) == len(patches)
    assert [path.patch for path in done.passes] == list(range(len(patches)))
    assert done.travel_length_mm < 0.05 * done.path_length_mm


def test_overlap_of_the_skin_keeps_the_volume(make):
    patches = make.nest(count=6)
    plain = _lay(make, patches)
    skin = _lay(make, patches, ToolpathSettings(skin_overlap_ratio=0.15))
    assert abs(deposited_volume(skin.passes) / deposited_volume(plain.passes) - 1) < 0.005
    gaps, _ = pass_gaps([path for path in skin.passes if path.layer == 0], SPACING)
    assert 0.75 < np.median(gaps) < 0.87


def test_the_same_input_gives_the_same_bytes(make):
    patches = make.nest(count=4)
    a, b = _lay(make, patches), _lay(make, patches)
    for one, other in zip(a.passes, b.passes):
        assert one.points.tobytes() == other.points.tobytes()
        assert one.width.tobytes() == other.width.tobytes()
    for one, other in zip(a.travels, b.travels):
        assert one.points.tobytes() == other.points.tobytes()


def test_a_report_can_stop_the_stage(make):
    def stop(progress):
        raise Cancelled("stop")

    patches = make.nest(count=2)
    with pytest.raises(Cancelled):
        lay_toolpaths(patches, make.stack(patches), make.cell(), PLAIN, stop)


@pytest.mark.parametrize(
    "change",
    [
        {"width_mm": 1.5},
        {"pattern": "zigzag"},
        {"pattern": "zigzag", "angle_deg": 30.0},
        {"spacing": "euclidean"},
        {"link_ratio": 0.0},
        {"skin_overlap_ratio": 0.2},
    ],
)
def test_every_setting_changes_the_passes(make, change):
    patches = make.nest(count=2, triangles=1500)
    base = PLAIN if "angle_deg" not in change else replace(PLAIN, pattern="zigzag")
    before = [path.points.tobytes() for path in _lay(make, patches, base).passes]
    after = [path.points.tobytes() for path in _lay(make, patches, replace(base, **change)).passes]
    assert before != after


def test_coverage_of_a_full_print_is_nearly_perfect(make):
    patches = make.nest(count=4)
    stack = make.stack(patches)
    done = _lay(make, patches)
    found = measure_coverage(patches, done, stack, 1.2)
    assert abs(found.deposited_mm3 / found.claimed_mm3 - 1) < 0.01
    bare = measure_coverage(patches, replace(done, passes=done.passes[:-1]), stack, 1.2)
    missing = volume_to_fill(patches[-1]) / stack.part.volume
    assert abs(bare.under_ratio - found.under_ratio - missing) < 0.01 * missing
