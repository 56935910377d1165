# SPDX-License-Identifier: Apache-2.0
"""Writes every print to an MCAP file, in a process of its own.

Runs as `python -m vega_robot_driver.recording.recorder STATE_FOLDER JOINT...` beside the
real-time process and ends with it: its standard input is a pipe from there. A file is
finished when its print ends, and also when the real-time process is killed.
"""

from __future__ import annotations

import select
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.errors import LinkTimeout
from vega_robot_driver.executor import STATES
from vega_robot_driver.recording import messages
from vega_robot_driver.recording.ring import Ring
from vega_robot_driver.status import StatusPage

#: Time between two looks at the ring [s].
PERIOD = 0.02
#: States in which a print is recorded, and time that is recorded after it [s of the machine].
RECORDED = ("printing", "pausing", "paused", "stopping")
AFTER = 0.3
TOPICS = {
    "/joint_states": "sensor_msgs/msg/JointState",
    "/joint_commands": "sensor_msgs/msg/JointState",
    "/dispenser/pressure": "sensor_msgs/msg/FluidPressure",
    "/dispenser/on": "std_msgs/msg/Bool",
    "/path_time": "std_msgs/msg/Float64",
    "/path_rate": "std_msgs/msg/Float64",
    "/events": "rcl_interfaces/msg/Log",
}


class PrintFile:
    """One file.

    Args:
        path: Where.
        joint_names: Names of the axes.
        job: Hash of the job.
    """

    def __init__(self, path: Path, joint_names: tuple[str, ...], job: str) -> None:
        from mcap.writer import CompressionType, Writer

        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("wb")
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="vega")
        self._writer.add_metadata("print", {"job": job, "joints": ",".join(joint_names)})
        schemas = {
            name: self._writer.register_schema(name, "ros2msg", text.encode())
            for name, text in messages.SCHEMAS.items()
        }
        self._channels = {
            topic: self._writer.register_channel(topic, "cdr", schemas[kind])
            for topic, kind in TOPICS.items()
        }
        self._names, self._sequence = joint_names, 0
        self._gate: bool | None = None

    def cycle(self, stamp: int, row: Any) -> None:
        """Write one cycle; the valve's state only where it changes."""
        axes = len(self._names)
        found, sent = row["positions"][:axes].tolist(), row["targets"][:axes].tolist()
        self._write("/joint_states", stamp, messages.joint_state(stamp, self._names, found))
        self._write("/joint_commands", stamp, messages.joint_state(stamp, self._names, sent))
        self._write("/dispenser/pressure", stamp, messages.pressure(stamp, float(row["pressure"])))
        self._write("/path_time", stamp, messages.number(float(row["u"])))
        self._write("/path_rate", stamp, messages.number(float(row["rate"])))
        gate = bool(row["gate"])
        if gate != self._gate:
            self._gate = gate
            self._write("/dispenser/on", stamp, messages.boolean(gate))

    def event(self, stamp: int, text: str, level: int = messages.INFO) -> None:
        """Write that something happened."""
        self._write("/events", stamp, messages.log(stamp, level, text))

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()
        self._file.close()

    def _write(self, topic: str, stamp: int, data: bytes) -> None:
        self._sequence += 1
        self._writer.add_message(
            self._channels[topic], stamp, data, publish_time=stamp, sequence=self._sequence
        )


class Recorder:
    """Turns rows of the ring into files.

    Args:
        folder: State folder.
        joint_names: Names of the axes.
    """

    def __init__(self, folder: Path, joint_names: tuple[str, ...]) -> None:
        self._folder, self._names = folder, joint_names
        self._ring, self._page = Ring(folder / "ring"), StatusPage(folder)
        self._began = time.time_ns()
        self._read = 0
        self._open: PrintFile | None = None
        self._state, self._path, self._bad = "", -1, 0
        self._until = 0.0

    def look(self) -> None:
        """Take what is new in the ring."""
        rows, self._read, lost = self._ring.take(self._read)
        if len(rows) and lost and self._open is not None:
            stamp = self._stamp(rows[0])
            self._open.event(stamp, f"{lost} cycles were not recorded", messages.WARN)
        for row in rows:
            self._take(row)

    def close(self, reason: str) -> None:
        """Take what is left and finish the file."""
        self.look()
        if self._open is not None:
            self._open.event(time.time_ns(), reason, messages.WARN)
            self._finish()

    def _take(self, row: Any) -> None:
        state = STATES[int(row["state"])]
        if self._open is None and state in RECORDED:
            self._begin()
        if self._open is not None:
            self._tell(self._open, self._stamp(row), row, state)
            if state in RECORDED:
                self._until = float(row["clock"]) + AFTER
            elif float(row["clock"]) > self._until or state == "off":
                self._finish()
        self._state = state

    def _begin(self) -> None:
        job = self._status("job")
        when = time.strftime("%Y%m%d-%H%M%S", time.localtime())
        name = f"{when}-{job[:12] or 'move'}"
        path = self._folder / "recordings" / f"{name}.mcap"
        count = 1
        while path.exists():
            count += 1
            path = path.with_name(f"{name}-{count}.mcap")
        self._open = PrintFile(path, self._names, job)
        self._path, self._state, self._bad = -1, "", 0

    def _tell(self, file: PrintFile, stamp: int, row: Any, state: str) -> None:
        if state != self._state:
            detail = self._status("detail") if state != "printing" else ""
            level = messages.ERROR if state == "fault" else messages.INFO
            file.event(stamp, f"{state}: {detail}" if detail else state, level)
        path = int(row["path"])
        if path != self._path:
            text = f"pass {path} of layer {row['layer']}" if path >= 0 else "travel"
            file.event(stamp, text)
            self._path = path
        bad = int(row["wrong_counters"])
        if self._bad and bad > self._bad:
            file.event(stamp, f"{bad - self._bad} wrong working counters", messages.WARN)
        self._bad = bad
        file.cycle(stamp, row)

    def _finish(self) -> None:
        if self._open is not None:
            self._open.close()
        self._open = None

    def _stamp(self, row: Any) -> int:
        return self._began + int(np.rint(float(row["clock"]) * 1e9))

    def _status(self, name: str) -> str:
        try:
            return str(getattr(self._page.read(), name))
        except LinkTimeout:
            return ""


def main() -> int:
    """Run until the real-time process is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    recorder = Recorder(Path(sys.argv[1]), tuple(sys.argv[2:]))
    while True:
        gone, _, _ = select.select([sys.stdin], [], [], PERIOD)
        if gone:
            recorder.close("the real-time process ended")
            return 0
        recorder.look()


if __name__ == "__main__":
    raise SystemExit(main())
