# SPDX-License-Identifier: Apache-2.0
"""The separating surface from noisy labels, against the border they were made from."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from vega_planner.datatypes import Layer
from vega_planner.printability.islands import neighbours_of, without_islands
from vega_planner.splitting.border import separating_field
from vega_planner.splitting.cut import cut_mesh
from vega_planner.splitting.gaussian_process import GaussianProcess, spread


def shell(fine: int) -> Layer:
    ball = trimesh.creation.icosphere(fine)
    v = np.array(ball.vertices) * [22, 20, 25]
    return Layer(0, "envelope", 0.4, v, np.array(ball.faces), np.full(len(v), 0.8))


def wavy(mesh: Layer) -> np.ndarray:
    """Distance of face middles from a wavy border on the steep wall, in degrees of tilt."""
    middle = mesh.vertices[mesh.faces].mean(1)
    tilt = np.degrees(np.arccos(mesh.face_normals[:, 2]))
    return 95 + 6 * np.sin(3 * np.arctan2(middle[:, 1], middle[:, 0])) - tilt


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_noise_of_the_labels_leaves_less_than_0_3_percent_on_the_wrong_side(seed):
    mesh = shell(5)  # 20 480 triangles
    truth = wavy(mesh)
    noise = np.random.default_rng(seed).normal(0, 1.5, len(mesh.faces))
    label = np.where(truth + noise > 0, 1, -1)
    neighbours = neighbours_of(mesh)
    label = without_islands(neighbours, mesh.face_areas, label, 6.0)
    field, deviation = separating_field(mesh, neighbours, label == 1)
    cut = cut_mesh(mesh.vertices, mesh.faces, field)
    corners = cut.vertices[cut.faces]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    wrong = (truth[cut.source] > 0) != cut.positive
    # faces on the border hold both: count what a finer truth would leave of them
    certain = np.abs(truth[cut.source]) > 0.75
    assert area[wrong & certain].sum() / area.sum() < 3e-3
    assert area[wrong].sum() / area.sum() < 8e-3
    assert abs(area.sum() / mesh.area - 1) < 1e-9
    assert 0 < deviation.max() < 1.0


def test_islands_take_the_label_around_them():
    mesh = shell(4)
    label = np.where(mesh.face_normals[:, 2] > 0, 1, -1)
    clean = label.copy()
    label[np.random.default_rng(0).integers(0, len(label), 40)] *= -1
    border = np.abs(mesh.face_normals[:, 2]) < 0.15
    found = without_islands(neighbours_of(mesh), mesh.face_areas, label, 8.0)
    assert (found == clean)[~border].all()


def test_regression_recovers_a_smooth_function_and_knows_its_noise():
    rng = np.random.default_rng(3)
    x = rng.uniform(-20, 20, (1500, 3))
    smooth = np.sin(x[:, 0] / 9) + 0.05 * x[:, 1]
    process = GaussianProcess(x, smooth + rng.normal(0, 0.1, len(x)), np.geomspace(4, 60, 6))
    probe = rng.uniform(-15, 15, (300, 3))
    error = process.mean(probe) - np.sin(probe[:, 0] / 9) - 0.05 * probe[:, 1]
    assert np.abs(error).mean() < 0.08
    assert 0.03 < process.noise < 0.3
    assert (np.abs(error) < 4 * process.deviation(probe) + 0.02).mean() > 0.95


def test_spread_points_are_spread():
    x = np.random.default_rng(0).random((2000, 3))
    chosen = x[spread(x, 60)]
    gaps = np.linalg.norm(chosen[:, None] - chosen[None], axis=2) + 9 * np.eye(60)
    assert gaps.min() > 0.15
