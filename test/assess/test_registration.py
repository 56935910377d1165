# SPDX-License-Identifier: Apache-2.0
"""Scans are found from any pose, measured to analytic figures, or refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from vega_planner.assess.evaluate import Scan, evaluate, measure
from vega_planner.assess.registration import pose_from_markers, register
from vega_planner.datatypes import Part
from vega_planner.errors import BadMesh, InvalidInput, NotRegistered
from vega_planner.results.ply import mesh_ply, read_mesh_ply


def lumpy(count_u=100, count_v=50) -> Part:
    """A closed body without symmetry, 50 mm long."""
    v = np.linspace(0, np.pi, count_v + 1)[1:-1]
    u = 2 * np.pi * np.arange(count_u) / count_u
    v, u = (axis.ravel() for axis in np.meshgrid(v, u, indexing="ij"))
    way = np.column_stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)])
    bump = 1 + 0.18 * np.sin(2 * u + 1) * np.sin(v) ** 2 + 0.15 * np.cos(3 * v + u) * np.sin(v)
    ring = way * bump[:, None] * [22, 15, 11]
    vertices = np.concatenate([ring, [[0, 0, 11.0]], [[0, 0, -11.0]]])
    here = np.arange(count_u)
    there = (here + 1) % count_u
    faces = []
    for k in range(count_v - 2):
        a, b = here + k * count_u, there + k * count_u
        faces += [
            np.column_stack([a, a + count_u, b]),
            np.column_stack([b, a + count_u, b + count_u]),
        ]
    top, bottom = np.full(count_u, len(ring)), np.full(count_u, len(ring) + 1)
    last = (count_v - 2) * count_u
    faces += [
        np.column_stack([here, there, top]),
        np.column_stack([there + last, here + last, bottom]),
    ]
    faces = np.concatenate(faces)
    vertices[:, 2] -= vertices[:, 2].min()
    return Part("lumpy", vertices, faces, np.zeros(len(faces), bool))


def random_pose(generator):
    turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    shift = generator.normal(size=3)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, 30 * shift / np.linalg.norm(shift)
    return pose


def errors(pose, truth, middle):
    """Distance [mm] and angle [deg] between T_target_scan and the inverse of the truth."""
    both = pose @ truth
    angle = np.degrees(np.arccos(np.clip((np.trace(both[:3, :3]) - 1) / 2, -1, 1)))
    return np.linalg.norm(both[:3, :3] @ middle + both[:3, 3] - middle), angle


def half_scan(part, generator, noise=0.03):
    """Half of the surface from a random side, with noise, in a random pose."""
    way = generator.normal(size=3)
    centres = part.vertices[part.faces].mean(1)
    keep = (centres - centres.mean(0)) @ way > 0
    scan = Scan(part.vertices, part.faces).part_of(keep)
    pose = random_pose(generator)
    noisy = scan.vertices + generator.normal(0, noise, scan.vertices.shape)
    return Scan(noisy @ pose[:3, :3].T + pose[:3, 3], scan.faces), pose


@pytest.fixture(scope="module")
def body():
    return lumpy()


@pytest.fixture(scope="module")
def ball(ideal):
    dome = ideal.round_part(20.0, np.pi / 2, 32, 80)
    upper = dome.faces[~dome.restrained]
    count = len(dome.vertices)
    vertices = np.concatenate([dome.vertices, dome.vertices * [1, 1, -1]])
    faces = np.concatenate([upper, upper[:, ::-1] + count])
    faces = np.where((faces >= count) & (faces < count + 80), faces - count, faces)
    used, flat = np.unique(faces, return_inverse=True)
    return Part("ball", vertices[used], flat.reshape(-1, 3), np.zeros(len(faces), bool))


def test_noisy_half_scans_in_any_pose_are_found(body):
    generator = np.random.default_rng(11)
    middle = body.vertices.mean(0)
    for _ in range(2):
        scan, pose = half_scan(body, generator)
        found = register(scan, body)
        shift, angle = errors(found.T_target_scan, pose, middle)
        assert shift <= 0.02 and angle <= 0.05
        assert not found.ambiguous


def test_registration_repeats_to_the_last_bit(body):
    scan, _ = half_scan(body, np.random.default_rng(4))
    first, second = register(scan, body), register(scan, body)
    assert np.array_equal(first.T_target_scan, second.T_target_scan)


def test_sphere_scaled_by_one_percent_has_the_known_measures(ball):
    result = measure(Scan(ball.vertices * 1.01, ball.faces), ball)
    assert result.closed
    assert result.fidelity.e1_pct == pytest.approx(100 * (1.01**3 - 1), rel=0.01)
    assert result.fidelity.under_pct == pytest.approx(0, abs=1e-3)
    assert result.fidelity.e2_mean_mm == pytest.approx(0.2, rel=0.01)
    assert result.fidelity.e3_mm2 == pytest.approx(2 * 0.2**2, rel=0.01)
    assert result.registration.ambiguous, "a sphere can turn on itself"


def test_shrunk_body_is_all_undershoot(body):
    middle = (body.vertices.max(0) + body.vertices.min(0)) / 2
    result = measure(Scan(middle + (body.vertices - middle) * 0.99, body.faces), body)
    assert result.fidelity.under_pct == pytest.approx(100 * (1 - 0.99**3), rel=0.01)
    assert result.fidelity.over_pct == pytest.approx(0, abs=1e-3)


def test_hole_in_a_scan_lowers_its_coverage_and_not_its_deviation(body):
    scan = Scan(body.vertices, body.faces)
    grown = Scan(body.vertices + 0.1 * body.vertex_normals, body.faces)
    centres = body.vertices[body.faces].mean(1)
    holed = grown.part_of(np.linalg.norm(centres - centres[1000], axis=1) > 8)
    result = measure(holed, body)
    missing = 1 - holed.area / scan.area
    assert missing > 0.03
    assert not result.closed
    assert result.coverage_ratio == pytest.approx(1 - missing, abs=0.02)
    assert result.fidelity.e2_mean_mm == pytest.approx(0.1, abs=0.01)
    assert result.fidelity.over_pct == pytest.approx(
        100 * 0.1 * holed.area / body.volume, rel=0.08
    )


def test_plate_and_clutter_are_cut_away(ideal):
    body = lumpy()
    cut = np.maximum(body.vertices, [-np.inf, -np.inf, 6.0]) - [0, 0, 6.0]
    part = Part("standing", cut, body.faces, (cut[body.faces][:, :, 2] < 1e-9).all(1))
    seen = Scan(part.vertices, part.faces).part_of(~part.restrained)
    axis = np.linspace(-60, 60, 61)
    x, y = (values.ravel() for values in np.meshgrid(axis, axis))
    corner = np.arange(61 * 60).reshape(60, 61)[:, :-1].ravel()
    plate = np.concatenate(
        [np.column_stack([corner, corner + 1, corner + 62]),
         np.column_stack([corner, corner + 62, corner + 61])]
    )  # fmt: skip
    box = ideal.block((8.0, 8.0, 15.0))
    vertices = np.concatenate(
        [seen.vertices, np.column_stack([x, y, 0 * x]), box.vertices + np.array([45, 5, 0])]
    )
    faces = np.concatenate(
        [seen.faces, plate + len(seen.vertices), box.faces + len(seen.vertices) + len(x)]
    )
    pose = random_pose(np.random.default_rng(8))
    noisy = vertices + np.random.default_rng(1).normal(0, 0.02, vertices.shape)
    result = measure(Scan(noisy @ pose[:3, :3].T + pose[:3, 3], faces), part)
    shift, angle = errors(result.registration.T_target_scan, pose, part.vertices.mean(0))
    assert shift < 0.05 and angle < 0.2
    assert result.scan.vertices[:, 2].max() < part.vertices[:, 2].max() + 0.2
    assert result.free.e2_mean_mm < 0.04


def test_scan_of_something_else_is_refused_and_says_why(body, ideal):
    box = ideal.block((30.0, 30.0, 30.0))
    with pytest.raises(NotRegistered, match="cannot be registered") as caught:
        measure(Scan(box.vertices, box.faces), body)
    assert caught.value.best.fit_ratio < 0.75


def test_markers_give_the_pose(body):
    generator = np.random.default_rng(2)
    pose = random_pose(generator)
    points = generator.uniform(-10, 10, (4, 3))
    found = pose_from_markers(points @ pose[:3, :3].T + pose[:3, 3], points)
    assert np.allclose(found @ pose, np.eye(4), atol=1e-9)
    with pytest.raises(InvalidInput, match="one line"):
        pose_from_markers(np.outer([0, 1, 2], [1.0, 2, 3]), np.outer([0, 1, 2], [1.0, 2, 3]))


def test_evaluation_writes_its_report(tmp_path, body):
    scan, _ = half_scan(body, np.random.default_rng(6))
    file = tmp_path / "scan.ply"
    file.write_bytes(mesh_ply(scan.vertices, scan.faces))
    figures = evaluate(file, body, tmp_path / "out")
    assert figures == json.loads((tmp_path / "out/metrics.json").read_text())
    assert {"e1_pct", "under_pct", "over_pct", "e2_mean_mm", "e3_mm2"} <= set(figures)
    assert figures["registration"]["certainty"] > 0.5
    _, _, extra = read_mesh_ply(tmp_path / "out/aligned.ply")
    assert np.abs(extra["deviation"]).mean() == pytest.approx(figures["e2_mean_mm"], rel=0.6)
    report = (tmp_path / "out/report.html").read_text()
    assert report.count("data:image/png;base64,") == 3
    assert "http://" not in report.replace("http://www.w3.org/2000/svg", "")
    assert "<script" not in report


def test_point_cloud_is_refused(tmp_path, body):
    file = tmp_path / "cloud.ply"
    file.write_bytes(mesh_ply(body.vertices, np.zeros((0, 3), int)))
    with pytest.raises(BadMesh):
        evaluate(file, body, tmp_path / "out")
    assert not (tmp_path / "out").exists()
