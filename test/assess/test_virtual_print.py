# SPDX-License-Identifier: Apache-2.0
"""Virtual prints of ideal paths against known volumes and the ruler's own promises."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from vega_planner.assess.beads import section_area, section_width
from vega_planner.assess.dispensing import Dispensing, dispensed
from vega_planner.assess.scanner import Scanner
from vega_planner.assess.virtual_print import simulate, simulate_folder
from vega_planner.datatypes import Part
from vega_planner.errors import InvalidInput
from vega_planner.results.ply import mesh_ply, read_mesh_ply

THICKNESS, WIDTH = 0.8, 1.2
AREA = float(section_area(np.array(WIDTH), np.array(THICKNESS)))


@pytest.fixture(scope="module")
def planar(ideal, dome):
    return simulate(ideal.planar_dome(20.0), dome, voxel_mm=0.2)


@pytest.fixture(scope="module")
def enveloping(ideal, dome):
    return simulate(ideal.enveloping_dome(20.0), dome, voxel_mm=0.2)


@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 0.6, 0.8)])
def test_single_bead_has_the_volume_of_a_stadium_with_round_ends(ideal, axis):
    beads = ideal.rows_of([ideal.line([-4, 0, 2], [4, 0, 2], axis, 9)])
    flat, side = WIDTH / 2 - THICKNESS / 2, THICKNESS / 2
    # half a puck at each end: a disc of the flat radius, and the round rim's volume
    ends = np.pi * flat**2 * THICKNESS + np.pi**2 * flat * side**2 + 4 / 3 * np.pi * side**3
    result = simulate(beads, ideal.block(), voxel_mm=0.05)
    assert result.volume_mm3 == pytest.approx(8 * AREA + ends, rel=2e-3)
    assert result.bead_volume_mm3 == pytest.approx(8 * AREA, rel=1e-6)


def test_bead_lies_where_its_axis_says(ideal):
    across = np.array([0.0, 0.6, 0.8])
    result = simulate(
        ideal.rows_of([ideal.line([-4, 0, 2], [4, 0, 2], across)]), ideal.block(), voxel_mm=0.05
    )
    middle = result.vertices[np.abs(result.vertices[:, 0]) < 2] - [0, 0, 2]
    assert np.abs(middle @ across).max() == pytest.approx(THICKNESS / 2, abs=0.005)
    assert np.abs(middle @ np.cross(across, [1, 0, 0])).max() == pytest.approx(
        WIDTH / 2, abs=0.005
    )


def test_plate_cuts_what_lies_below_it(ideal):
    result = simulate(
        ideal.rows_of([ideal.line([-4, 0, 0], [4, 0, 0])]), ideal.block(), voxel_mm=0.05
    )
    assert result.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-3)
    whole = simulate(
        ideal.rows_of([ideal.line([-4, 0, 0], [4, 0, 0])]),
        ideal.block(),
        voxel_mm=0.05,
        plate_z_mm=-5.0,
    )
    assert result.volume_mm3 == pytest.approx(whole.volume_mm3 / 2, rel=5e-3)


def test_a_wall_without_thickness_on_a_substrate_cuts_nothing_off(ideal):
    """Bodies cut out of each other leave such walls: two faces at one place."""
    beads = ideal.rows_of([ideal.line([-4, 0, 2], [4, 0, 2])])
    box = trimesh.creation.box(bounds=[[-6, -3, -2], [6, 3, 1.2]])
    fin = np.array([[-5, 0.1, 1.2], [5, 0.1, 1.2], [5, 0.1, 4], [-5, 0.1, 4]], float)
    count = len(box.vertices)
    sheet = count + np.array([[0, 1, 2], [0, 2, 3]])
    faces = np.vstack([box.faces, sheet, sheet[:, ::-1]])
    finned = Part("s", np.vstack([box.vertices, fin]), faces, np.zeros(len(faces), bool))
    plain = Part("s", box.vertices, box.faces, np.zeros(len(box.faces), bool))
    volumes = [
        simulate(beads, ideal.block(), voxel_mm=0.1, plate_z_mm=-2.0, substrate=body).volume_mm3
        for body in (plain, finned)
    ]
    assert volumes[1] == pytest.approx(volumes[0], rel=1e-3)


def test_closed_void_is_filled_and_reported_apart(ideal):
    ring = [ideal.line([-3, y, z], [3, y, z]) for y in (-0.9, 0.0, 0.9) for z in (0.4, 2.0)]
    ring += [ideal.line([-3, y, 1.2], [3, y, 1.2]) for y in (-0.9, 0.9)]
    ring += [ideal.line([x, -0.9, 1.2], [x, 0.9, 1.2]) for x in (-3.0, 3.0)]
    result = simulate(ideal.rows_of(ring), ideal.block(), voxel_mm=0.05)
    spots = np.random.default_rng(0).uniform([-2.9, -0.8, 0.4], [2.9, 0.8, 2.0], (200_000, 3))
    free = np.ones(len(spots), bool)
    for points, _ in ring:
        way = points[1] - points[0]
        at = np.clip((spots - points[0]) @ way / (way @ way), 0, 1)
        away = spots - points[0] - at[:, None] * way
        flat = np.maximum(np.linalg.norm(away[:, :2], axis=1) - (WIDTH - THICKNESS) / 2, 0)
        free &= np.hypot(flat, away[:, 2]) > THICKNESS / 2
    expected = free.mean() * 5.8 * 1.6 * 1.6
    assert result.voids.volume_mm3 == pytest.approx(expected, rel=0.03)
    assert result.voids.volume_mm3 >= result.voids.largest_mm3
    inside = np.abs(result.vertices - [0, 0, 1.2]) < [2.0, 0.2, 0.2]
    assert not inside.all(1).any()


def test_ideal_enveloping_paths_beat_ideal_planar_ones_on_a_dome(planar, enveloping):
    """With perfect beads, e1 falls by about three quarters and e2 by two thirds or more."""
    assert planar.fidelity.e1_pct == pytest.approx(1.6, abs=0.35)
    assert planar.fidelity.e2_mean_mm == pytest.approx(0.091, abs=0.012)
    assert enveloping.free.e2_mean_mm == pytest.approx(0.029, abs=0.005)
    assert enveloping.fidelity.e1_pct < 0.3 * planar.fidelity.e1_pct
    assert enveloping.free.e2_mean_mm < 0.32 * planar.free.e2_mean_mm
    assert enveloping.free.e3_mm2 < 0.25 * planar.free.e3_mm2


def test_whole_error_is_the_sum_of_its_parts(planar):
    for figures in (planar.fidelity, planar.free):
        assert figures.e1_pct == pytest.approx(figures.under_pct + figures.over_pct)
    volume = planar.volume_mm3 / (2 / 3 * np.pi * 8000)
    gain = (planar.fidelity.over_pct - planar.fidelity.under_pct) / 100
    assert volume - 1 == pytest.approx(gain, abs=1e-3)


def test_base_counts_only_where_everything_counts(planar):
    assert planar.free.e1_pct < planar.fidelity.e1_pct
    assert planar.free.e2_mean_mm > planar.fidelity.e2_mean_mm


def test_half_the_voxel_moves_e1_of_a_small_dome_by_less_than_two_percent(ideal):
    beads = ideal.enveloping_dome(4.0)
    part = ideal.round_part(4.0, np.pi / 2)
    coarse = simulate(beads, part, voxel_mm=0.1).fidelity.e1_pct
    fine = simulate(beads, part, voxel_mm=0.05).fidelity.e1_pct
    assert abs(coarse / fine - 1) < 0.02


def test_printed_surface_is_closed_and_has_the_reported_volume(enveloping):
    a, b, c = (enveloping.vertices[enveloping.faces[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert volume == pytest.approx(enveloping.volume_mm3, rel=1e-3)


def test_same_print_gives_the_same_bytes(ideal, small_dome):
    first, second = (
        simulate(ideal.enveloping_dome(8.0), small_dome, voxel_mm=0.2) for _ in range(2)
    )
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert json.dumps(first.as_dict()) == json.dumps(second.as_dict())


def test_too_small_voxels_are_refused_with_the_least_possible(ideal, dome):
    with pytest.raises(InvalidInput, match="least possible"):
        simulate(ideal.enveloping_dome(20.0), dome, voxel_mm=0.01)


@pytest.mark.parametrize(
    ("errors", "ratio"),
    [
        (Dispensing(flow_ratio=1.3), 1.3),
        (Dispensing(speed_ratio=0.5), 2.0),
        (Dispensing(start_lag_mm=2.0), 0.75),
        (Dispensing(stop_lag_mm=-2.0), 0.75),
    ],
)
def test_dispensing_errors_change_the_volume_as_they_say(ideal, errors, ratio):
    beads = ideal.rows_of([ideal.line([-4, 0, 2], [4, 0, 2], count=81)])
    assert dispensed(beads, errors).volume_mm3 == pytest.approx(8 * AREA * ratio, rel=0.02)


def test_late_stop_piles_its_volume_up_at_the_end(ideal):
    beads = ideal.rows_of([ideal.line([-4, 0, 2], [4, 0, 2], count=81)])
    plain = simulate(beads, ideal.block(), voxel_mm=0.1)
    piled = simulate(beads, ideal.block(), voxel_mm=0.1, dispensing=Dispensing(stop_lag_mm=1.5))
    assert piled.volume_mm3 - plain.volume_mm3 == pytest.approx(1.5 * AREA, rel=0.1)


def test_ripple_and_wander_repeat_with_the_seed(ideal):
    beads = ideal.rows_of([ideal.line([-4, 0, 2], [4, 0, 2], count=81)])
    errors = Dispensing(ripple_ratio=0.1, wander_mm=0.05)
    first, again, other = (dispensed(beads, errors, seed) for seed in (1, 1, 2))
    assert np.array_equal(first.points, again.points)
    assert np.array_equal(first.width, again.width)
    assert not np.array_equal(first.points, other.points)


def test_scanner_noise_widens_the_deviation_by_itself(ideal, small_dome):
    beads = ideal.enveloping_dome(8.0)
    plain = simulate(beads, small_dome, voxel_mm=0.2)
    noisy = simulate(beads, small_dome, voxel_mm=0.2, scanner=Scanner(noise_mm=0.05))
    added = np.average(noisy.deviation.signed**2) - np.average(plain.deviation.signed**2)
    assert added == pytest.approx(0.05**2, rel=0.2)


def test_scanner_resolution_smooths_grooves(ideal):
    beads, part = ideal.enveloping_dome(5.0), ideal.round_part(5.0, np.pi / 2)
    sharp = simulate(beads, part, voxel_mm=0.1)
    smooth = simulate(beads, part, voxel_mm=0.1, scanner=Scanner(resolution_mm=0.6))
    assert smooth.free.e2_p95_mm < 0.9 * sharp.free.e2_p95_mm


@pytest.mark.parametrize("area", [0.1, 0.4, 0.8227, 2.0])
def test_width_of_a_section_gives_its_area_back(area):
    height = np.array([0.8])
    width = section_width(np.array([area]), height)
    assert section_area(width, height)[0] == pytest.approx(area)


def test_folder_is_simulated_in_place(ideal, tmp_path, small_dome):
    beads = ideal.enveloping_dome(8.0)
    (tmp_path / "part.ply").write_bytes(mesh_ply(small_dome.vertices, small_dome.faces))
    used, flat = np.unique(small_dome.faces[small_dome.restrained], return_inverse=True)
    (tmp_path / "restraint.ply").write_bytes(
        mesh_ply(small_dome.vertices[used], flat.reshape(-1, 3))
    )
    (tmp_path / "summary.json").write_text('{"plate_z_mm": 0.0}')
    table = np.column_stack(
        [beads.path_id, beads.path_id, beads.path_id, beads.points, beads.axes,
         beads.width, beads.height, beads.extrude]
    )  # fmt: skip
    header = "path_id,layer,patch,x_mm,y_mm,z_mm,tool_x,tool_y,tool_z,width_mm,height_mm,extrude"
    np.savetxt(tmp_path / "toolpath.csv", table, "%.9g", delimiter=",", header=header, comments="")
    figures = simulate_folder(tmp_path, voxel_mm=0.2)
    assert figures == json.loads((tmp_path / "fidelity.json").read_text())
    direct = simulate(beads, small_dome, voxel_mm=0.2)
    assert figures["e1_pct"] == pytest.approx(direct.fidelity.e1_pct, rel=1e-3)
    assert figures["free"]["e1_pct"] == pytest.approx(direct.free.e1_pct, rel=1e-3)
    vertices, _, extra = read_mesh_ply(tmp_path / "printed.ply")
    assert len(vertices) == len(extra["deviation"]) == len(direct.vertices)


def test_full_sphere_without_restraint_counts_everything(ideal):
    ball = ideal.round_part(5.0, np.pi / 2)
    loose = Part("ball", ball.vertices, ball.faces, np.zeros(len(ball.faces), bool))
    result = simulate(ideal.enveloping_dome(5.0), loose, voxel_mm=0.2)
    assert result.free == result.fidelity
