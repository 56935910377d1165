# SPDX-License-Identifier: Apache-2.0
"""The planner in a process of its own: plans, cancels, refuses, and stays up."""

from __future__ import annotations

import json
import threading
import time

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_processes import Background, until
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from vega_msgs.action import PlanLayers
from vega_msgs.msg import Setting
from vega_planner.errors import BadMesh, Busy, Cancelled, InvalidInput
from vega_planner.nodes.conversions import layers_from_msg, mesh_to_msg, toolpaths_from_msg
from vega_planner.progress import silent

QUICK = [
    Setting(key="layers.thickness_mm", value="0.8"),
    Setting(key="toolpaths.width_mm", value="1.2"),
]
#: Thin layers: seconds of work.
LONG = [
    Setting(key="layers.thickness_mm", value="0.2"),
    Setting(key="toolpaths.width_mm", value="0.3"),
]


def box(side: float = 12.0) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([(x, y, z) for x in (0, side) for y in (0, side) for z in (0, side)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [tri for a, b, c, d in quads for tri in ((a, b, c), (a, c, d))]
    return corners, np.array(faces)


def goal(side: float = 12.0, **values) -> PlanLayers.Goal:
    values = {"brr": ["down"], "options": QUICK, **values}
    return PlanLayers.Goal(inline_mesh=mesh_to_msg(*box(side)), **values)


def test_plans_an_inline_mesh_and_sends_what_was_asked_for(session, planner, tmp_path):
    stages = []
    result = session.plan(
        goal(output_folder=str(tmp_path / "out"), include_geometry=True, include_trajectory=True),
        lambda progress: stages.append((progress.fraction, progress.stage)),
    )
    assert result.error_code == PlanLayers.Result.NONE
    assert result.status != "not"
    summary = json.loads(result.summary)
    assert summary["volume_mm3"] == pytest.approx(12.0**3, rel=1e-3)
    assert len(layers_from_msg(result.layers)) == result.layer_count >= summary["layers"] > 0
    passes = toolpaths_from_msg(result.toolpaths)
    assert len(passes) == result.path_count == summary["passes"]
    assert sum(p.length_mm for p in passes) == pytest.approx(summary["path_length_mm"], abs=0.01)
    assert result.trajectory.times[-1] == pytest.approx(result.duration)
    assert len(result.joint_trajectory.points) == 0
    assert {"part", "layers", "trajectory"} <= {stage for _, stage in stages}
    assert [fraction for fraction, _ in stages] == sorted(fraction for fraction, _ in stages)
    assert json.loads((tmp_path / "out" / "certificate.json").read_text()) == json.loads(
        result.certificate
    )


def test_who_comes_late_sees_layers_and_toolpath(session, planner):
    result = session.plan(goal(), silent)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    seen: dict[str, list] = {"layers": [], "toolpath": [], "toolpath_speed": []}
    subscriptions = [
        session.node.create_subscription(MarkerArray, name, seen[name].append, latched)
        for name in seen
    ]
    until(lambda: all(seen.values()))
    names = {marker.ns for marker in seen["layers"][0].markers}
    assert seen["layers"][0].markers[0].action == 3  # delete all that was shown before
    assert {f"layer_{index:03d}" for index in range(result.layer_count)} <= names
    assert "restraint" in names
    by_layer, by_speed = (seen[name][0].markers[1:] for name in ("toolpath", "toolpath_speed"))
    assert [m.points for m in by_layer] == [m.points for m in by_speed]
    for marker in by_speed:
        assert marker.ns == "travel" or len(marker.colors) == len(marker.points)
    again = session.node.create_client(Trigger, "planner/republish")
    until(again.service_is_ready)
    assert session._call(again, Trigger.Request()).success
    until(lambda: len(seen["layers"]) > 1)
    for subscription in subscriptions:
        session.node.destroy_subscription(subscription)


def test_a_plan_is_cancelled_in_the_middle(session, planner):
    in_the_middle = threading.Event()

    def report(progress):
        if progress.stage not in ("part", "cell"):
            in_the_middle.set()

    running = Background(lambda: session.plan(goal(30.0, options=LONG), report))
    assert in_the_middle.wait(60)
    began = time.monotonic()
    session.cancel()
    with pytest.raises(Cancelled):
        running.result()
    assert time.monotonic() - began < 10
    assert session.plan(goal(), silent).error_code == 0


def test_a_second_plan_is_refused_while_one_runs(session, planner):
    started = threading.Event()
    running = Background(
        lambda: session.plan(goal(30.0, options=LONG), lambda progress: started.set())
    )
    assert started.wait(60)
    first = session._goal
    with pytest.raises(Busy):
        session.plan(goal(), silent)
    session._goal = first
    session.cancel()
    with pytest.raises(Cancelled):
        running.result()


@pytest.mark.parametrize(
    ("content", "kind"),
    [(None, BadMesh), (b"", BadMesh), (b"solid nothing", BadMesh), (b"\0" * 500, BadMesh)],
)
def test_a_bad_mesh_is_refused_and_the_node_stays_up(session, planner, tmp_path, content, kind):
    mesh = tmp_path / "bad.stl"
    if content is not None:
        mesh.write_bytes(content)
    out = tmp_path / "out"
    with pytest.raises(kind) as caught:
        session.plan(PlanLayers.Goal(mesh=str(mesh), output_folder=str(out)), silent)
    assert "\n" not in str(caught.value)
    assert not out.exists()
    assert planner.running


def test_a_wrong_setting_is_refused(session, planner):
    with pytest.raises(InvalidInput, match="thickness_mm"):
        session.plan(goal(options=[Setting(key="layers.thickness_mm", value="-1")]), silent)


def test_a_goal_without_a_mesh_is_refused(session, planner):
    with pytest.raises(BadMesh, match="carries none"):
        session.plan(PlanLayers.Goal(), silent)
