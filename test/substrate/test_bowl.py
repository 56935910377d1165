# SPDX-License-Identifier: Apache-2.0
"""Substrates: closed, clear of the part, no higher than its rim, open upwards."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from vega_planner.datatypes import Part
from vega_planner.errors import InvalidInput
from vega_planner.robot.workcell import load_cell
from vega_planner.settings import CellSettings
from vega_planner.substrate import make_substrate, stand_on_substrate, stands_flat
from vega_planner.substrate.bowl import lower_side
from vega_planner.substrate.skirts import _straightened


def egg() -> Part:
    ball = trimesh.creation.icosphere(4)
    v = np.array(ball.vertices) * [20, 14, 12] + [0, 0, 12]
    return Part("egg", v, np.array(ball.faces), np.zeros(len(ball.faces), bool))


def solid(mesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)


def implicit(points: np.ndarray) -> np.ndarray:
    """Negative inside the egg."""
    return (((points - [0, 0, 12]) / [20, 14, 12]) ** 2).sum(1) - 1


def test_bowl_of_an_egg_is_closed_and_stands_on_its_floor():
    bowl = make_substrate(egg(), floor_mm=2.5)
    mesh = solid(bowl)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    assert mesh.body_count == 1
    assert mesh.bounds[0, 2] == pytest.approx(-2.5)
    assert mesh.bounds[1, 2] == pytest.approx(12.0, abs=0.6)


@pytest.mark.parametrize("clearance", [0.05, 0.3])
def test_the_gap_to_the_part_is_the_clearance(clearance):
    mesh = solid(make_substrate(egg(), clearance_mm=clearance))
    points, face = trimesh.sample.sample_surface(mesh, 20000, seed=1)
    assert implicit(points).min() > 0
    inner = points[(mesh.face_normals[face][:, 2] > 0.2) & (implicit(points) < 0.15)]
    ball = egg()
    gap = cKDTree(ball.vertices).query(inner)[0]
    assert len(inner) > 500
    assert np.median(gap) < clearance + 0.6
    assert gap.min() >= 0.7 * clearance


def test_the_outer_walls_widen_downwards_by_the_draft():
    wide = solid(make_substrate(egg(), draft_deg=10.0, foot_mm=0.0))
    section = wide.vertices[np.abs(wide.vertices[:, 2] - 0.0) < 1e-6]
    top = wide.vertices[wide.vertices[:, 2] > 11.0]
    assert np.abs(section[:, 0]).max() > np.abs(top[:, 0]).max() + 1.5


def test_a_lower_edge_can_be_chosen():
    assert solid(make_substrate(egg(), height_mm=5.0)).bounds[1, 2] == pytest.approx(5.0)


def test_the_part_can_be_lifted_out():
    mesh = solid(make_substrate(egg()))
    rng = np.random.default_rng(0)
    points = rng.uniform([-19, -13, 0.5], [19, 13, 11.5], (4000, 3))
    points = points[implicit(points) < -0.02]
    from vega_planner.printability.line_of_sight import Occluder

    class _Mesh:
        vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)

    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    assert not Occluder(_Mesh()).blocks(points, up).any()


def test_impossible_dimensions_are_refused_by_name():
    with pytest.raises(InvalidInput, match="height_mm is 99"):
        make_substrate(egg(), height_mm=99.0)
    with pytest.raises(InvalidInput, match="clearance_mm is -1"):
        make_substrate(egg(), clearance_mm=-1.0)
    with pytest.raises(InvalidInput, match=r"floor_mm is 0\.05"):
        make_substrate(egg(), floor_mm=0.05)


def test_only_parts_without_a_flat_base_get_one():
    cell = load_cell(CellSettings())
    box = trimesh.creation.box((20, 20, 10))
    v = np.array(box.vertices) + np.array([0, 0, 5])
    flat = Part("box", v, np.array(box.faces), np.zeros(len(box.faces), bool))
    assert stands_flat(flat) and not stands_flat(egg())
    assert stand_on_substrate(cell, flat).substrate is None
    lifted = stand_on_substrate(cell, egg())
    assert lifted.substrate is not None
    assert lifted.placement.plate_z_mm == pytest.approx(-2.0)
    assert lifted.placement.T_base_part[2, 3] - cell.placement.T_base_part[2, 3] == (
        pytest.approx(0.002)
    )


def test_a_funnel_is_carried_by_its_small_foot():
    ring = np.array([[3, 0], [3, 12], [18, 28], [16, 28], [1.5, 13], [1.5, 0], [3, 0]], float)
    shape = trimesh.creation.revolve(ring, sections=48)
    shape.fix_normals()
    free = np.zeros(len(shape.faces), bool)
    part = Part("funnel", np.array(shape.vertices), np.array(shape.faces), free)
    side = lower_side(part)
    assert part.vertices[part.faces[side]][:, :, 2].max() < 1e-9
    low = make_substrate(part)
    assert low.height_mm < 1.0


def test_a_rim_that_is_nearly_straight_takes_few_pieces():
    corners = np.array([[0, 0, 0], [0.5, 0.01, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    edges = _straightened(corners, np.array([[0, 1], [1, 2], [2, 3], [3, 4], [4, 0]]))
    assert edges.tolist() == [[0, 2], [2, 3], [3, 4], [4, 0]]
