# SPDX-License-Identifier: Apache-2.0
"""Recordings, read back by readers that are not ours."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rcl_interfaces.msg import Log
from rclpy.serialization import deserialize_message
from scipy.interpolate import CubicHermiteSpline
from sensor_msgs.msg import FluidPressure, JointState
from std_msgs.msg import Bool, Float64

sys.path.insert(0, str(Path(__file__).parent))
from synthetic import JOINTS, machine, zigzag_job
from test_process import send, until

from vega_robot_driver.link import MachineLink
from vega_robot_driver.recording import messages


def recorded(folder: Path) -> dict:
    """The messages of the only recording by topic, as (time [s], message)."""
    (path,) = (folder / "recordings").glob("*.mcap")
    topics: dict = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for _, channel, message, decoded in reader.iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time * 1e-9, decoded))
    return topics


def test_a_print_is_recorded_whole_for_any_reader(tmp_path):
    job = zigzag_job(2)
    link = MachineLink(tmp_path, machine(time_scale=20.0))
    link.ask("enable")
    send(link, job)
    link.ask("run")
    until(lambda: link.status().state == "done")
    link.close()
    topics = recorded(tmp_path)
    u = np.array([m.data for _, m in topics["/path_time"]])
    sent = np.array([m.position for _, m in topics["/joint_commands"]])
    found = np.array([m.position for _, m in topics["/joint_states"]])
    assert topics["/joint_states"][0][1].name == list(JOINTS)
    path = CubicHermiteSpline(job.times, job.positions, job.velocities)
    inside = u > 0
    assert np.abs(path(u[inside]) - sent[inside]).max() < 1e-9
    assert 0 < np.abs(found - sent)[:, :3].max() < 2e-3
    assert u[-1] == job.duration_s
    times = np.array([t for t, _ in topics["/path_time"]])
    whole = (u > 0.2) & (u < job.duration_s)
    assert np.allclose(np.diff(times[whole]), np.diff(u[whole]), atol=1e-3)
    assert [m.data for _, m in topics["/dispenser/on"]] == [False, True, False, True, False]
    assert max(m.fluid_pressure for _, m in topics["/dispenser/pressure"]) > 120e3
    told = [m.msg for _, m in topics["/events"]]
    assert told[0] == "printing" and "done" in told
    assert [t for t in told if t.startswith("pass")] == ["pass 0 of layer 0", "pass 1 of layer 0"]


def test_a_killed_machine_leaves_a_finished_recording(tmp_path):
    link = MachineLink(tmp_path, machine(time_scale=2.0))
    link.ask("enable")
    send(link, zigzag_job(3))
    link.ask("run")
    until(lambda: link.status().dispenser_on)
    os.kill(link.status().pid, signal.SIGKILL)

    def finished() -> bool:
        found = list((tmp_path / "recordings").glob("*.mcap"))
        return bool(found) and found[0].read_bytes()[-8:] == b"\x89MCAP0\r\n"

    until(finished)
    link.close(shut_down=False)
    told = [m.msg for _, m in recorded(tmp_path)["/events"]]
    assert told[-1] == "the real-time process ended"


def test_the_messages_are_those_of_ros():
    """Bytes and fields are what the middleware itself writes and reads."""
    stamp = 1_700_000_000_123_456_789
    state = deserialize_message(
        messages.joint_state(stamp, ("x", "y_axis"), (0.25, -1.5)),
        JointState,
    )
    assert (state.header.stamp.sec, state.header.stamp.nanosec) == divmod(stamp, 10**9)
    assert list(state.name) == ["x", "y_axis"]
    assert list(state.position) == [0.25, -1.5]
    assert len(state.velocity) == len(state.effort) == 0
    air = deserialize_message(messages.pressure(stamp, 130e3), FluidPressure)
    assert (air.header.frame_id, air.fluid_pressure) == ("dispenser", 130e3)
    line = deserialize_message(messages.log(stamp, messages.ERROR, "fault: jam"), Log)
    assert (line.level, line.name, line.msg, line.line) == (40, "robot_driver", "fault: jam", 0)
    assert deserialize_message(messages.boolean(True), Bool).data
    number = deserialize_message(messages.number(2.5), Float64)
    assert number.data == 2.5
