# SPDX-License-Identifier: Apache-2.0
"""What RViz is told: every display finds its topic, prints grow, late joiners see everything."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import Point, PointStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from ros_processes import Background, until
from std_msgs.msg import Header, String
from synthetic import zigzag_job
from test_driver_node import goal
from visualization_msgs.msg import Marker, MarkerArray

from vega_planner.datatypes import Layer, LayerStack, Part, PrintabilityReport
from vega_planner.nodes import frames
from vega_planner.nodes.markers import layer_markers
from vega_planner.progress import silent
from vega_planner.robot.robot import load_robot
from vega_robot_driver.nodes.printed import Bead, beads_of

VIEW = Path(__file__).resolve().parents[2] / "rviz" / "print.rviz"
#: Message types of the display classes, and the property that names the topic.
SHOWN = {
    "rviz_default_plugins/MarkerArray": ("visualization_msgs/msg/MarkerArray", "Topic"),
    "rviz_default_plugins/RobotModel": ("std_msgs/msg/String", "Description Topic"),
}
NO_TOPIC = {"rviz_default_plugins/Grid", "rviz_default_plugins/TF"}


def manager() -> dict[str, Any]:
    return yaml.safe_load(VIEW.read_text())["Visualization Manager"]


def latched(depth: int = 1) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


class Picture:
    """The markers that a display shows after the messages it received."""

    def __init__(self, session: Any, topic: str, depth: int = 1) -> None:
        self._node, self.messages = session.node, 0
        self.markers: dict[tuple[str, int], Marker] = {}
        self._subscription = self._node.create_subscription(
            MarkerArray, topic, self._take, latched(depth)
        )

    def _take(self, message: MarkerArray) -> None:
        shown = dict(self.markers)
        for marker in message.markers:
            if marker.action == Marker.DELETEALL:
                shown = {}
            else:
                shown[marker.ns, marker.id] = marker
        self.markers = shown
        self.messages += 1

    def length(self, namespace: str) -> float:
        """Length of all lines of a namespace [m]."""
        lines = [points_of(m) for (ns, _), m in list(self.markers.items()) if ns == namespace]
        return sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines)

    def close(self) -> None:
        self._node.destroy_subscription(self._subscription)


def points_of(marker: Marker) -> np.ndarray:
    return np.array([(p.x, p.y, p.z) for p in marker.points])


@pytest.fixture
def look(session: Any) -> Any:
    pictures: list[Picture] = []

    def open_picture(topic: str, depth: int = 1) -> Picture:
        pictures.append(Picture(session, topic, depth))
        return pictures[-1]

    yield open_picture
    for picture in pictures:
        picture.close()


def test_every_display_of_the_view_finds_its_topic(session, planner, driver):
    """Type, reliability and durability fit, so that RViz is sent what was latched."""
    for display in manager()["Displays"]:
        if display["Class"] in NO_TOPIC:
            continue
        kind, key = SHOWN[display["Class"]]
        topic = display[key]
        until(lambda topic=topic: session.node.get_publishers_info_by_topic(topic["Value"]))
        offers = session.node.get_publishers_info_by_topic(topic["Value"])
        assert {offer.topic_type for offer in offers} == {kind}, topic
        assert topic["Durability Policy"] == "Transient Local"
        assert topic["Reliability Policy"] == "Reliable"
        for offer in offers:
            assert offer.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            assert offer.qos_profile.reliability == ReliabilityPolicy.RELIABLE


def test_the_tool_of_the_view_is_listened_to(session, planner):
    tools = [tool for tool in manager()["Tools"] if "Topic" in tool]
    assert [tool["Topic"]["Value"] for tool in tools] == ["/clicked_point"]
    until(lambda: session.node.get_subscriptions_info_by_topic("/clicked_point"))


def test_a_clicked_point_is_answered_with_its_spec(session, planner):
    heard: list[str] = []
    node = session.node
    subscription = node.create_subscription(
        String, "restraint_spec", lambda message: heard.append(message.data), 10
    )
    publisher = node.create_publisher(PointStamped, "clicked_point", 10)
    until(lambda: publisher.get_subscription_count() and node.count_publishers("restraint_spec"))
    message = PointStamped(header=Header(frame_id="part"), point=Point(x=0.0125, y=-0.003, z=0.0))

    def answered() -> bool:
        publisher.publish(message)
        return bool(heard)

    until(answered)
    assert heard[0] == "point:12.5,-3,0"
    node.destroy_subscription(subscription)
    node.destroy_publisher(publisher)


def test_the_printed_bead_and_the_trail_grow_and_late_joiners_see_all(session, driver, look):
    """What was added bit by bit is what a late joiner is sent whole, and as long as the job's."""
    printed, trail = look("/printed", 50), look("/trail")
    job = zigzag_job(12)
    running = Background(lambda: session.execute(goal(12), silent))
    lengths: list[float] = [0.0]
    ends: list[np.ndarray] = []

    def trail_moves_on() -> bool:
        shown = trail.markers.get(("trail", 0))
        return shown is not None and (
            not ends or bool(np.linalg.norm(points_of(shown)[-1] - ends[-1]) > 0)
        )

    while len(lengths) < 4:
        until(lambda: printed.length("printed") > lengths[-1] + 1e-3)
        lengths.append(printed.length("printed"))
        until(trail_moves_on)
        ends.append(points_of(trail.markers["trail", 0])[-1])
    running.result()
    tips, _ = load_robot("vega5").forward(job.positions)
    step = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    laid = step[job.extrude[1:] & (job.path_id[1:] >= 0)].sum()
    until(lambda: printed.length("printed") == pytest.approx(laid, rel=1e-6))
    late = look("/printed", 50)
    until(lambda: late.length("printed") == pytest.approx(laid, rel=1e-6))
    assert late.markers.keys() == printed.markers.keys()
    nozzle = trail.markers["nozzle", 0]
    assert np.allclose(points_of(nozzle)[1], tips[-1], atol=1e-3)
    again = look("/trail")
    until(lambda: again.messages)
    assert {marker.header.frame_id for marker in late.markers.values()} == {"base"}
    shown = again.markers["trail", 0]
    assert len(shown.colors) == len(shown.points) > 10
    assert shown.colors[0].a < shown.colors[-1].a


def test_where_the_part_stands_is_told_in_the_frame_that_is_fixed(monkeypatch):
    """Markers come in `part` and `base`; the planner ties the first to the second."""
    assert manager()["Global Options"]["Fixed Frame"] == "base"
    sent: list[Any] = []

    class Transforms:
        def __init__(self, transforms: list[Any]) -> None:
            self.transforms = transforms

    class Node:
        def create_publisher(self, kind: Any, topic: str, qos: QoSProfile) -> Any:
            assert topic == "/tf_static"
            assert qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
            return type("Publisher", (), {"publish": staticmethod(sent.append)})()

        def get_clock(self) -> Any:
            import rclpy.clock

            return rclpy.clock.Clock()

    monkeypatch.setattr(frames, "TFMessage", Transforms)
    T = np.array([[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1.0]])
    frames.FramePublisher(Node()).publish(T)  # type: ignore[arg-type]
    (frame,) = sent[0].transforms
    assert (frame.header.frame_id, frame.child_frame_id) == ("base", "part")
    place, turn = frame.transform.translation, frame.transform.rotation
    assert (place.x, place.y, place.z) == (0.1, 0.2, 0.3)
    assert (turn.z, turn.w) == pytest.approx((np.sqrt(0.5), np.sqrt(0.5)))


def test_collisions_and_other_reasons_have_namespaces_and_colours_of_their_own():
    corners = np.array([(0, 0, 0), (9, 0, 0), (9, 9, 0), (0, 9, 0)], float)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    part = Part("p", corners, faces, np.array([True, False]), ("down",))
    sheets = tuple(
        Layer(n, "envelope", 0.4, corners + np.array([0, 0, n]), faces, np.full(4, 0.8))
        for n in range(2)
    )
    reasons = (np.array([0, 2]), np.array([3, 0]))  # wrist_limit, own_layer
    report = PrintabilityReport("conditionally", 1.0, 1.0, 1.0, face_reasons=reasons)
    stack = LayerStack(part, "field", 0.8, sheets)
    shown = {(m.namespace, m.number): m for m in layer_markers(stack, report)}
    assert set(shown) == {
        ("layer_000", 0), ("layer_001", 1), ("restraint", 0),
        ("unprintable_wrist_limit", 0), ("collision_own_layer", 1),
    }  # fmt: skip
    marks = shown["unprintable_wrist_limit", 0], shown["collision_own_layer", 1]
    assert marks[0].color != marks[1].color
    expected = sheets[1].vertices[faces[0]] / 1000
    assert np.allclose(marks[1].points, expected, atol=1e-4)
    assert (marks[1].points[:, 2] > expected[:, 2]).all()


def test_beads_are_the_stretches_with_the_dispenser_on_cut_where_lines_get_long():
    job = zigzag_job(3)
    tips = job.positions[:, :3]
    beads = beads_of(job, tips)
    assert len(beads) == 3
    assert [bead.layer for bead in beads] == [0, 0, 1]
    assert all(np.isclose(np.ptp(bead.points[:, 0]), 0.02, atol=1e-4) for bead in beads)
    on = job.intervals()
    assert np.allclose([(bead.times[0], bead.times[-1]) for bead in beads], on)


def test_a_bead_ends_where_the_tip_is():
    bead = Bead(np.array([(0, 0, 0), (2, 0, 0), (2, 4, 0.0)]), np.array([1.0, 2.0, 4.0]), 0)
    assert np.array_equal(bead.until(3.0), [(0, 0, 0), (2, 0, 0), (2, 2, 0)])
    assert np.array_equal(bead.until(4.0), bead.points)
    assert np.array_equal(bead.until(1.5), [(0, 0, 0), (1, 0, 0)])
