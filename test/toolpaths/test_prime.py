# SPDX-License-Identifier: Apache-2.0
"""The prime line: on the plate, clear of the part, first, and no part of the print."""

from types import SimpleNamespace

import numpy as np
import pytest

from vega_planner.assess.beads import beads_of
from vega_planner.errors import InvalidInput
from vega_planner.settings import ToolpathSettings
from vega_planner.toolpaths import lay_toolpaths
from vega_planner.toolpaths.coverage import measure_coverage
from vega_planner.toolpaths.prime import AWAY_MM, with_prime_line

SIZE = {"length_mm": 30.0, "width_mm": 1.2, "height_mm": 0.8}


def _cell(make, within=lambda points: np.ones(len(points), bool)):
    plain = make.cell(-0.3)
    return SimpleNamespace(**vars(plain), reachable=lambda points, axes: within(points))


@pytest.fixture
def job(make):
    patches = make.nest(count=3)
    cell = _cell(make)
    settings = ToolpathSettings(skin_overlap_ratio=0.0)
    return (
        patches,
        make.stack(patches),
        lay_toolpaths(patches, make.stack(patches), cell, settings),
    )


def test_it_comes_first_stands_on_the_plate_and_keeps_away_from_the_part(make, job):
    _, _, plain = job
    primed = with_prime_line(plain, _cell(make), **SIZE)
    line, *rest = primed.passes
    assert tuple(rest) == plain.passes and primed.travels[2:] == plain.travels[1:]
    assert (line.patch, line.layer) == (-1, -1)
    assert line.length_mm == pytest.approx(30.0)
    np.testing.assert_allclose(line.points[:, 2] - 0.5 * line.height, -0.3)
    printed = np.concatenate([path.points for path in rest])
    gap = np.linalg.norm(line.points[:, None, :2] - printed[None, :, :2], axis=2).min()
    assert gap >= AWAY_MM
    for path, into, out in zip(primed.passes, primed.travels, primed.travels[1:]):
        np.testing.assert_allclose(into.points[-1], path.points[0])
        np.testing.assert_allclose(out.points[0], path.points[-1])


def test_it_does_not_count_as_part_of_the_print(make, job):
    patches, stack, plain = job
    primed = with_prime_line(plain, _cell(make), **SIZE)
    before = measure_coverage(patches, plain, stack, 1.2)
    assert measure_coverage(patches, primed, stack, 1.2) == before
    np.testing.assert_array_equal(beads_of(primed).points, beads_of(plain).points)


@pytest.mark.parametrize(("axis", "sign"), [(0, 1), (0, -1), (1, 1), (1, -1)])
def test_it_is_laid_where_the_robot_reaches(make, job, axis, sign):
    plain = job[2]
    line = with_prime_line(
        plain, _cell(make, lambda points: sign * points[:, axis] > 20.0), **SIZE
    ).passes[0]
    assert (sign * line.points[:, axis] > 20.0).all()


def test_no_side_within_reach_is_told(make, job):
    with pytest.raises(InvalidInput, match=r"prime line of 30 mm.*toolpaths\.prime_mm"):
        with_prime_line(job[2], _cell(make, lambda points: np.zeros(len(points), bool)), **SIZE)


def test_none_is_laid_unless_asked_for(make, job):
    assert with_prime_line(job[2], _cell(make), **{**SIZE, "length_mm": 0.0}) is job[2]
