# SPDX-License-Identifier: Apache-2.0
"""The whole flow on real parts, judged by independent means."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pinocchio
import pytest
import trimesh

from vega_planner import Settings, load_settings, plan
from vega_planner.errors import Cancelled, NotPrintable, Unreachable, VegaError
from vega_planner.results.tables import read_table
from vega_planner.shared_files import shared_file

PARTS = Path(__file__).resolve().parent.parent / "parts"


def plan_part(name, changes=None):
    path = next(PARTS.glob(f"{name}_*.stl"))
    settings = load_settings(path.with_suffix(".yaml"))
    return plan(path, settings.updated(changes or {}))


@pytest.fixture(scope="module")
def dome():
    return plan_part("part1")


@pytest.fixture(scope="module")
def dome_folder(dome, tmp_path_factory):
    return dome.write(tmp_path_factory.mktemp("plan") / "dome")


def test_the_layers_are_level_sets_of_the_depth(dome):
    """Checked with trimesh's nearest points, which share nothing with the engine."""
    part = dome.part
    free = trimesh.Trimesh(part.vertices, part.faces[~part.restrained], process=False)
    for layer in dome.stack.layers[::5]:
        points = layer.vertices[:: max(1, len(layer.vertices) // 300)]
        _, distance, _ = trimesh.proximity.closest_point(free, points)
        error = np.abs(distance - layer.depth_mm)
        assert np.quantile(error, 0.99) <= 0.02
        assert layer.depth_mm == pytest.approx((layer.index + 0.5) * 0.8)


def test_the_joints_carry_the_tip_along_the_toolpath(dome, dome_folder):
    """The URDF's own kinematics by pinocchio, against the two tables a machine would read."""
    motion = read_table(dome_folder / "trajectory.csv")
    rows = read_table(dome_folder / "toolpath.csv")
    urdf = shared_file("urdf", "vega5.urdf")
    model = pinocchio.buildModelFromUrdf(str(urdf))
    data = model.createData()
    frame = model.getFrameId("tip")
    summary = json.loads((dome_folder / "summary.json").read_text())
    to_base = np.array(summary["T_base_part"])
    names = [name for name in model.names if name in motion]
    joints = np.column_stack([motion[name] for name in names])
    rng = np.random.default_rng(0)
    for path_id in rng.choice(len(dome.toolpaths.passes), 4, replace=False):
        mine = rows["path_id"] == path_id
        points = np.column_stack([rows[f"{axis}_mm"][mine] for axis in "xyz"])
        at = np.flatnonzero(motion["path_id"] == path_id)
        for sample in rng.choice(at, min(40, len(at)), replace=False):
            pinocchio.framesForwardKinematics(model, data, joints[sample])
            tip = data.oMf[frame].translation
            tip_mm = (np.linalg.inv(to_base) @ np.append(tip, 1.0))[:3] * 1000.0
            assert distance_to_line(tip_mm, points) <= 0.011


def distance_to_line(point, line):
    start, step = line[:-1], np.diff(line, axis=0)
    square = np.maximum((step**2).sum(1), 1e-18)
    share = np.clip(((point - start) * step).sum(1) / square, 0, 1)
    return np.linalg.norm(start + share[:, None] * step - point, axis=1).min()


def test_the_beads_hold_the_volume_of_the_part(dome):
    volume = 0.0
    for path in dome.toolpaths.passes:
        step = np.linalg.norm(np.diff(path.points, axis=0), axis=1)
        width, height = path.width, path.height
        section = (width - height) * height + np.pi * height**2 / 4
        volume += (step * 0.5 * (section[1:] + section[:-1])).sum()
    assert volume == pytest.approx(dome.part.volume, rel=0.02)


def test_nothing_is_hit_and_all_of_a_planar_base_part_is_printable(dome):
    assert dome.printability.status == "fully"
    assert dome.collisions["colliding_waypoints"] == 0
    assert dome.certificate["collision_free"]


def digest(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    hashes = {}
    for path in files:
        data = path.read_bytes()
        if path.name == "summary.json":
            summary = json.loads(data)
            for key in ("stages", "total_s", "peak_memory_mb"):
                del summary[key]
            data = json.dumps(summary).encode()
        hashes[str(path.relative_to(folder))] = hashlib.sha256(data).hexdigest()
    return hashes


def test_envelopes_are_printed_from_the_inside_out_and_none_floats(dome):
    """However small the first ones are, and whatever slivers their rims have."""
    kinds = [dome.stack.sheets[patch.layer].kind for patch in dome.patches]
    order = [p.layer for p, kind in zip(dome.patches, kinds) if kind == "envelope"]
    assert order == sorted(order, reverse=True)
    assert not dome.printability.reasons


def test_the_same_input_gives_the_same_bytes(dome_folder, tmp_path):
    again = plan_part("part1").write(tmp_path / "again")
    assert digest(again) == digest(dome_folder)


def test_the_folder_holds_what_others_rely_on(dome, dome_folder):
    names = {path.name for path in dome_folder.iterdir()}
    assert {
        "part.ply", "restraint.ply", "layers", "patches", "toolpath.csv", "trajectory.csv",
        "summary.json", "plan.html", "certificate.json",
    } <= names  # fmt: skip
    summary = json.loads((dome_folder / "summary.json").read_text())
    assert summary["layers"] == len(list((dome_folder / "layers").glob("layer_*.ply")))
    assert len(dome.patches) == len(list((dome_folder / "patches").glob("patch_*.ply")))
    part = trimesh.load(dome_folder / "part.ply", process=False)
    assert part.is_watertight and part.volume > 0
    assert part.bounds[0, 2] == pytest.approx(0, abs=1e-9)
    assert summary["brr"]["faces"] == dome.part.restrained.sum()


def test_a_prism_restrained_all_but_on_top_is_sliced_like_by_any_slicer():
    result = plan_part("part0")
    top = result.part.bounds[1, 2]
    for layer in result.stack.layers:
        heights = layer.vertices[:, 2]
        assert np.ptp(heights) <= 2e-3
        assert heights.mean() == pytest.approx(top - layer.depth_mm, abs=1e-3)
        flat = abs(trimesh.Trimesh(layer.vertices, layer.faces, process=False).area)
        cut = trimesh.Trimesh(result.part.vertices, result.part.faces, process=False).section(
            plane_origin=[0, 0, heights.mean()], plane_normal=[0, 0, 1]
        )
        assert flat == pytest.approx(cut.to_2D()[0].area, rel=2e-3)


def test_a_closed_part_is_split_and_printed_on_its_substrate_without_touching():
    result = plan_part("part5")
    assert result.part.restrained.sum() == 0
    assert result.printability.status == "conditionally"
    assert result.cell.placement.plate_z_mm < 0 and result.cell.substrate is not None
    assert result.collisions["colliding_waypoints"] == 0


def test_a_six_axis_arm_plans_too():
    result = plan_part("part1", {"cell": {"robot": "ur5e"}, "layers": {"thickness_mm": 2.0},
                                 "toolpaths": {"width_mm": 3.0}})  # fmt: skip
    assert len(result.trajectory.joint_names) == 6
    assert result.printability.reachable_ratio == 1.0


def test_a_part_out_of_reach_says_so_and_by_how_much():
    try:
        result = plan_part("part1", {"cell": {"pose": "900,0,0,0"}})
    except NotPrintable as error:
        assert "reach" in str(error)
    else:
        assert result.printability.status == "not"
        assert {reason.code for reason in result.printability.reasons} & {
            "out_of_travel", "wrist_limit"
        }  # fmt: skip


def test_the_pose_auto_finds_the_travel_of_a_gantry_that_does_not_span_the_middle(tmp_path):
    urdf = shared_file("urdf", "vega5.urdf").read_text()
    lopsided = urdf.replace('lower="-0.2" upper="0.2"', 'lower="0.0" upper="0.4"', 1)
    assert lopsided != urdf
    (tmp_path / "lopsided.urdf").write_text(lopsided)
    cell = {"robot": str(tmp_path / "lopsided.urdf")}
    coarse = {"layers": {"thickness_mm": 2.0}, "toolpaths": {"width_mm": 3.0}}
    with pytest.raises(Unreachable, match="out of the robot's reach"):
        plan_part("part1", coarse | {"cell": cell | {"pose": "0,0,0,0"}})
    found = plan_part("part1", coarse | {"cell": cell | {"pose": "auto"}})
    assert found.printability.status == "fully"
    assert found.printability.reachable_ratio == 1.0
    x_axis = found.trajectory.positions[:, found.trajectory.joint_names.index("x_axis")]
    assert x_axis.min() >= 0.0 and x_axis.max() <= 0.4


@pytest.mark.parametrize("stage", ["layers", "printability", "toolpaths", "trajectory"])
def test_a_job_stops_in_any_stage_when_told(stage):
    seen = []

    def stop(progress):
        seen.append(progress.stage)
        if progress.stage == stage:
            raise Cancelled("stop")

    with pytest.raises(Cancelled):
        plan(next(PARTS.glob("part1_*.stl")), Settings(), stop)
    assert seen[-1] == stage


def test_progress_never_falls_and_ends_at_one():
    seen = []
    plan(next(PARTS.glob("part2_*.stl")), Settings(), lambda p: seen.append(p.fraction))
    assert seen == sorted(seen) and seen[0] == 0 and seen[-1] == 1


def test_an_error_knows_the_stage_it_came_from():
    with pytest.raises(VegaError) as caught:
        plan(next(PARTS.glob("part1_*.stl")), Settings().updated({"cell": {"robot": "nobody"}}))
    assert caught.value.stage == "cell"
    assert "nobody" in str(caught.value) and "vega5" in str(caught.value)
