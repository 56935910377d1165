# SPDX-License-Identifier: Apache-2.0
"""Compensation takes a known systematic error out of the second print."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vega_planner.assess.compensate import compensated_part
from vega_planner.assess.virtual_print import simulate
from vega_planner.errors import InvalidInput
from vega_planner.results.ply import mesh_ply

STRETCH = np.array([1.03, 1.03, 1.05])


def stretched(beads):
    """A machine whose lengths are wrong."""
    return replace(beads, points=beads.points * STRETCH)


def shaped(ideal, part, radius=8.0):
    """Perfect paths of a dome, moved to a part that is nearly that dome."""
    beads = ideal.enveloping_dome(radius)
    ways = part.vertices / np.maximum(np.linalg.norm(part.vertices, axis=1), 1e-9)[:, None]
    outer = part.vertices[:, 2] > 0.2
    reach = np.linalg.norm(part.vertices, axis=1)
    length = np.linalg.norm(beads.points, axis=1)
    near = np.argmax(beads.points / length[:, None] @ ways[outer].T, axis=1)
    return replace(beads, points=beads.points * (reach[outer][near] / radius)[:, None])


def test_second_print_deviates_less_than_half_as_much(tmp_path, ideal, small_dome):
    first = simulate(stretched(ideal.enveloping_dome(8.0)), small_dome, voxel_mm=0.2)
    (tmp_path / "printed.ply").write_bytes(
        mesh_ply(first.vertices, first.faces, {"deviation": first.deviation.signed})
    )
    target = compensated_part(small_dome, tmp_path)
    second = simulate(stretched(shaped(ideal, target)), small_dome, voxel_mm=0.2)
    assert second.free.e2_mean_mm < 0.5 * first.free.e2_mean_mm


def test_compensated_target_mirrors_a_uniform_deviation(tmp_path, small_dome):
    grown = small_dome.vertices + 0.2 * small_dome.vertex_normals
    deviation = np.full(len(grown), 0.2)
    (tmp_path / "aligned.ply").write_bytes(
        mesh_ply(grown, small_dome.faces, {"deviation": deviation})
    )
    target = compensated_part(small_dome, tmp_path)
    high = target.vertices[:, 2] > 2
    assert np.linalg.norm(target.vertices[high], axis=1) == pytest.approx(7.8, abs=0.02)
    assert target.vertices[:, 2].min() == 0
    base = target.vertices[target.faces[target.restrained]]
    assert np.abs(base[:, :, 2]).max() == 0
    assert "0.2" in target.warnings[-1]


def test_deviation_beyond_the_bound_moves_the_target_by_the_bound(tmp_path, small_dome):
    (tmp_path / "aligned.ply").write_bytes(
        mesh_ply(
            small_dome.vertices,
            small_dome.faces,
            {"deviation": np.full(len(small_dome.vertices), 3.0)},
        )
    )
    target = compensated_part(small_dome, tmp_path)
    assert np.linalg.norm(target.vertices, axis=1).max() == pytest.approx(7.0, abs=0.02)


def test_folder_without_deviation_is_refused(tmp_path, small_dome):
    with pytest.raises(InvalidInput, match="no measured deviation"):
        compensated_part(small_dome, tmp_path)
