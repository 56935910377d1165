# SPDX-License-Identifier: Apache-2.0
"""What happens to a print when a process dies, freezes, or a serial line fails in mid-bead.

All processes are those of a print, at the pace of the clock: client, real-time process, drives
on a line of two virtual interfaces. Times are counted in cycles of the machine, of 2 ms, by
what came back from the drives; how much later than that the computer was is told beside.
So a stall of a computer that does other things too is not taken for the machine's.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from driver_job import ROOT, beads, bus_file, machine

from vega_robot_driver.emulators.musashi_device import MusashiDevice
from vega_robot_driver.job import PrintJob
from vega_robot_driver.link import MachineLink
from vega_robot_driver.recording.ring import Ring
from vega_robot_driver.status import StatusPage

DT = 0.002
#: Way between two cycles below which an axis stands: half an increment [m, rad].
STILL = 0.5e-6
#: The output that opens the valve, or cuts the air.
WIRED = {"axis": "x_axis", "bit": 16}
#: Time after which nothing more is expected of a machine that stands [s], and tries to bring
#: a print to where something is done to it.
QUIET_S, TRIES = 0.3, 5


class NotBegun(Exception):
    """The print did not come to where something was to be done to it."""


def send(link: MachineLink, job: PrintJob, **options: float) -> None:
    """Give a machine a job that begins where its axes are led by themselves."""
    arrays = {name: getattr(job, name) for name in job.__dataclass_fields__}
    np.savez(link.folder / "job.npz", waypoints=np.zeros((0, 5)), **arrays)
    link.ask("load", job="job.npz", **options)


def until(condition: Callable[[], Any], seconds: float = 30.0) -> None:
    """Wait for something.

    Raises:
        NotBegun: If it does not come to be.
    """
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise NotBegun(f"not within {seconds:g} s")
        time.sleep(0.001)


def valve_at_rest(folder: Path) -> int:
    """Steps of time in which the drives saw the valve open at standstill, so far."""
    return int(json.loads((folder / "drives.json").read_text())["on_at_standstill"])


@dataclass(frozen=True)
class Moment:
    """A moment of a machine: its cycles, the steady clock, and `valve_at_rest`."""

    cycles: int
    clock: float
    at_rest: int


def moment(folder: Path) -> Moment:
    """Look at a machine that prints."""
    return Moment(Ring(folder / "ring").written, time.monotonic(), valve_at_rest(folder))


def settled(folder: Path, since: Moment) -> dict[str, Any]:
    """Wait until the machine stands with the valve closed, and tell the times."""
    ring, quiet = Ring(folder / "ring"), round(QUIET_S / DT)

    def rows() -> np.ndarray:
        return ring.take(since.cycles)[0]

    def at_rest() -> bool:
        return bool(len(found := rows()) > max(_last(found)) + quiet)

    until(at_rest)
    found, passed = rows(), time.monotonic() - since.clock
    moved, opened = _last(found)
    return {
        "standstill_ms": round(1e3 * DT * (moved + 1), 1),
        "valve_closed_ms": round(1e3 * DT * (opened + 2), 1),
        "on_at_standstill": valve_at_rest(folder) - since.at_rest,
        "computer_late_ms": round(1e3 * max(passed - DT * len(found), 0.0), 1),
    }


def _last(rows: np.ndarray) -> tuple[int, int]:
    """The last cycles in which an axis moved and in which the valve was open, -1 for none."""
    way = np.abs(np.diff(rows["positions"], axis=0)).max(axis=1, initial=0.0)
    moved, opened = np.flatnonzero(way > STILL) + 1, np.flatnonzero(rows["gate"])
    return int(moved.max(initial=-1)), int(opened.max(initial=-1))


def in_mid_bead(folder: Path) -> None:
    """Wait for the middle of a bead.

    Raises:
        NotBegun: If the print ends otherwise.
    """
    page = StatusPage(folder)

    def there() -> bool:
        status = page.read()
        if status.state in ("fault", "stopped", "done"):
            raise NotBegun(f"{status.state}: {status.detail}")
        return status.state == "printing" and status.u > 1.0 and status.dispenser_on

    until(there)
    time.sleep(0.05)


@contextmanager
def printing(length: float = 60e-3, **bus: Any) -> Iterator[MachineLink]:
    """A print in mid-bead."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        config = str(bus_file(folder, **bus))
        link = MachineLink(folder, machine(time_scale=1.0, config=config, orphan_s=2.0))
        try:
            link.ask("enable")
            send(link, beads(1, length))
            link.ask("run")
            in_mid_bead(folder)
            yield link
        finally:
            link.close()


def pause() -> dict[str, Any]:
    """Pause in mid-bead."""
    with printing() as link:
        before = moment(link.folder)
        link.ask("pause")
        row = settled(link.folder, before)
        return row | _ended(link.folder, "paused")


CLIENT = """
import sys, time
sys.path.insert(0, {here!r})
from pathlib import Path
from driver_processes import MachineLink, beads, machine, send
link = MachineLink(Path({folder!r}), machine(time_scale=1.0, orphan_s=2.0))
link.ask("enable")
send(link, beads(1, 60e-3))
link.ask("run")
time.sleep(60)
"""


def struck_client(way: signal.Signals) -> dict[str, Any]:
    """Kill or freeze the process that asked for a print."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        code = CLIENT.format(here=str(ROOT / "bench"), folder=str(folder))
        client = subprocess.Popen([sys.executable, "-c", code])
        try:
            return _struck(client, folder, way)
        finally:
            client.kill()
            client.wait()
            MachineLink(folder, None).close()


def _struck(process: subprocess.Popen, folder: Path, way: signal.Signals) -> dict[str, Any]:
    until(lambda: process.poll() is not None or (folder / "ready").is_file(), 60)
    until(lambda: process.poll() is not None or StatusPage(folder).read().state == "printing")
    if process.poll() is not None:
        raise NotBegun("the client ended before the print began")
    in_mid_bead(folder)
    before = moment(folder)
    os.kill(process.pid, way)
    return settled(folder, before) | _ended(folder, "stopped")


def _ended(folder: Path, wanted: str) -> dict[str, Any]:
    status = StatusPage(folder).read()
    safe = status.state == wanted and not status.dispenser_on
    return {"state": status.state, "detail": status.detail, "safe": safe}


def serial_line_dies() -> dict[str, Any]:
    """Let the dispenser's serial line die; its start is wired."""
    device = MusashiDevice()
    try:
        with printing(dispenser={**WIRED, "port": device.port}) as link:
            before = moment(link.folder)
            device.misbehaviour = "silent"
            row = settled(link.folder, before) | _ended(link.folder, "fault")
            row["safe"] = row["safe"] and device.pressure == 1300
            return row
    finally:
        device.close()


def reading_lost() -> dict[str, Any]:
    """Let the answer to one reading be lost: it is asked for again, and the print goes on."""
    device = MusashiDevice()
    try:
        with printing(20e-3, dispenser={**WIRED, "port": device.port}) as link:
            before = moment(link.folder)
            device.misbehaviour = "lose_verdict"
            until(lambda: link.status().state != "printing")
            row = settled(link.folder, before) | _ended(link.folder, "done")
            row["safe"] = row["safe"] and not device.misbehaviour and device.pressure == 1300
            return row | {"standstill_ms": None, "valve_closed_ms": None}
    finally:
        device.close()


def start_lost() -> dict[str, Any]:
    """Let the answer to a shot's start be lost, where the line starts shots.

    Nothing on the line can stop the shot; the output cuts the air.
    """
    device = MusashiDevice(dialect="ml_808gx")
    shots = {"port": device.port, "dialect": "ml_808gx", "writes": True, "shot_s": 0.1}
    try:
        with printing(dispenser={**WIRED, **shots}) as link:
            until(lambda: device.starts > 2)
            before = moment(link.folder)
            device.misbehaviour = "lose_start"
            row = settled(link.folder, before) | _ended(link.folder, "fault")
            started = device.starts
            row["shot_ended"] = not device.open
            time.sleep(0.3)
            row["safe"] = row["safe"] and device.starts == started and not device.open
            return row
    finally:
        device.close()


def struck_node() -> dict[str, Any] | None:
    """Kill the ROS node; None where ROS is not installed."""
    try:
        from vega_msgs.action import ExecutePrint
        from vega_msgs.msg import JointPath
        from vega_planner.nodes.session import Session
    except ImportError:
        return None
    import rclpy

    os.environ["ROS_DOMAIN_ID"] = str(101 + os.getpid() % 100)
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    job = beads(1, 60e-3)
    path = JointPath(
        joint_names=list(job.joint_names),
        times=job.times.tolist(),
        positions=job.positions.ravel().tolist(),
        velocities=job.velocities.ravel().tolist(),
        extrude=job.extrude.tolist(),
        path_id=job.path_id.tolist(),
        path_layer=job.path_layer.tolist(),
    )
    goal = ExecutePrint.Goal(trajectory=path)
    goal.certificate = json.dumps({"sha256": {"job": job.digest()}})
    rclpy.init()
    with tempfile.TemporaryDirectory() as scratch:
        state = Path(scratch) / "machine"
        given = {
            "hardware": "emulated",
            "realtime": True,
            "state_folder": str(state),
            "orphan_time": 2.0,
        }
        words = [w for k, v in given.items() for w in ("-p", f"{k}:={json.dumps(v)}")]
        command = [sys.executable, "-m", "vega_robot_driver.nodes.robot_driver", "--ros-args"]
        with (Path(scratch) / "log").open("ab") as log:
            node = subprocess.Popen([*command, *words], stdout=log, stderr=log, cwd=ROOT)
        session = Session(name="bench")
        try:
            session.bring_up()
            threading.Thread(target=_ignored(session, goal), daemon=True).start()
            return _struck(node, state, signal.SIGKILL)
        finally:
            node.kill()
            node.wait()
            session.close()
            rclpy.try_shutdown()
            MachineLink(state, None).close()


def _ignored(session: Any, goal: Any) -> Callable[[], None]:
    def work() -> None:
        try:
            session.execute(goal, lambda _: None)
        except Exception as error:  # its node is killed
            print(f"the print's client: {error}", file=sys.stderr)

    return work


def slowest(run: Callable[[], dict[str, Any] | None], runs: int) -> dict[str, Any]:
    """The slowest of some runs; one that ends otherwise than it should is the slowest of all."""
    rows: list[dict[str, Any]] = []
    reasons: list[str] = []
    while len(rows) < runs:
        try:
            row = run()
        except NotBegun as error:
            reasons.append(str(error))
            if len(reasons) > TRIES:
                raise
            continue
        if row is None:
            return {}
        rows.append(row)
    worst = max(rows, key=lambda row: (not row["safe"], row["standstill_ms"] or 0.0))
    worst["on_at_standstill"] = max(row["on_at_standstill"] for row in rows)
    worst["computer_late_ms"] = max(row["computer_late_ms"] for row in rows)
    return worst | {"runs": len(rows), "not_begun": reasons}


def rows(runs: int, *, ros: bool) -> dict[str, dict[str, Any]]:
    """Let everything happen, each some times."""
    table = {
        "pause": slowest(pause, runs),
        "killed client": slowest(lambda: struck_client(signal.SIGKILL), runs),
        "frozen client": slowest(lambda: struck_client(signal.SIGSTOP), runs),
        "killed ROS node": slowest(struck_node, 1) if ros else {},
        "serial line dead": slowest(serial_line_dies, runs),
        "A0 of a reading lost": slowest(reading_lost, 1),
        "A0 of a shot's start lost": slowest(start_lost, 1),
    }
    return {name: row for name, row in table.items() if row}
