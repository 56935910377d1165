# SPDX-License-Identifier: Apache-2.0
"""What happens when something fails: time to standstill, and to the valve's closing.

Faults that are injected into the line run on drives whose time is the frames', and come out
the same on any computer. What concerns processes and serial lines runs by the clock, in the
processes that a print has.
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
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from driver_job import ROOT, beads, bus_file, machine

from vega_robot_driver.dispenser.digital_output import DigitalOutputDispenser
from vega_robot_driver.emulators.musashi_device import MusashiDevice
from vega_robot_driver.executor import Executor, Limits
from vega_robot_driver.job import PrintJob
from vega_robot_driver.link import MachineLink
from vega_robot_driver.motion.bus_config import read_bus_config
from vega_robot_driver.motion.direct_bus import DirectDrives, DirectMotion
from vega_robot_driver.status import StatusPage

DT = 0.002
#: Values of the bus for runs by the clock: ten cycles may be missed, and then all stops.
PATIENT = {"wrong_counters": 10, "watchdog_ms": 200, "sync_error_limit": 27}
#: Injected faults, in words and for the line.
INJECTED = {
    "jam": "jam 0",
    "drive fault": "drive_fault 1",
    "safe torque off of one drive": "torque_off 3",
    "limit switch": "limit_switch 0",
    "unplug after drive 2": "unplug 2",
    "lost frames (20)": "lose_frames 20",
    "wrong counters (5)": "wrong_counters 5",
    "frozen master (300 ms)": "silence 300",
}


def direct(folder: Path) -> tuple[Executor, DirectDrives]:
    """A machine on drives in this process, with clocks and a limit of missed cycles."""
    told = machine()
    config = read_bus_config(bus_file(folder, watchdog_ms=50, sync_error_limit=8))
    drives = DirectDrives(config, DT)
    motion = DirectMotion(
        config.for_joints(told.joint_names, told.lower, told.upper, told.velocity), drives, dt=DT
    )
    limits = ("lower", "upper", "velocity", "acceleration")
    executor = Executor(
        motion, DigitalOutputDispenser(), Limits(*(np.array(getattr(told, k)) for k in limits))
    )
    motion.open()
    executor.enable()
    return executor, drives


def injected() -> dict[str, dict[str, Any]]:
    """Let each fault of the line happen in the middle of a bead."""
    table = {}
    for name, fault in INJECTED.items():
        with tempfile.TemporaryDirectory() as folder:
            executor, drives = direct(Path(folder))
        executor.load(beads(1, 40e-3))
        executor.run()
        while executor.u < 2.0:
            executor.advance(1)
        assert executor.gate and executor.rate == 1.0
        drives.inject(fault)
        for _ in range(250):
            executor.advance(1)
        told = drives.line.told()
        row = times(told, told["injected"], DT)
        row["state"], row["detail"] = executor.state, executor.detail
        still = told["drives"]
        row["safe"] = executor.state == "fault" and not any(d["outputs"] for d in still)
        table[name] = row
    return table


def times(told: dict[str, Any], began: float, resolution: float) -> dict[str, Any]:
    """Times to standstill and to the closed valve, and how long it was open at standstill."""
    before = told.get("on_at_standstill_before", 0)
    return {
        "standstill_ms": round(1e3 * max(told["last_moving"] - began + resolution, 0.0), 1),
        "valve_closed_ms": round(1e3 * max(told["last_open"] - began + resolution, 0.0), 1),
        "on_at_standstill": told["on_at_standstill"] - before,
    }


# -- by the clock -------------------------------------------------------------------------


def send(link: MachineLink, job: PrintJob, **options: float) -> None:
    arrays = {name: getattr(job, name) for name in job.__dataclass_fields__}
    np.savez(link.folder / "job.npz", waypoints=np.zeros((0, 5)), **arrays)
    link.ask("load", job="job.npz", **options)


def until(condition: Callable[[], Any], seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("the machine did not come so far; a stall of the computer?")
        time.sleep(0.001)


def drives_of(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "drives.json").read_text())


def clocked(folder: Path, **bus: Any) -> Any:
    """A machine that runs by the clock, patient with a computer that others use too."""
    config = bus_file(folder, **PATIENT, **bus)
    return machine(time_scale=1.0, config=str(config), orphan_s=2.0)


def in_mid_bead(folder: Path) -> bool:
    status = StatusPage(folder).read()
    return status.state == "printing" and status.u > 1.0 and status.dispenser_on


def settled(folder: Path, began: float) -> dict[str, Any]:
    """Wait until the drives stand with the valve closed, and tell the times."""

    def done() -> bool:
        told = drives_of(folder)
        quiet = told["time"] - max(told["last_moving"], told["last_open"])
        return quiet > 0.3 and told["time"] > began + 0.3

    until(done, 10.0)
    return times(drives_of(folder), began, 0.001)


@contextmanager
def printing(**bus: Any) -> Iterator[tuple[MachineLink, Path, int]]:
    """A print by the clock, in mid-bead."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        link = MachineLink(folder, clocked(folder, **bus))
        try:
            link.ask("enable")
            send(link, beads(1, 60e-3))
            link.ask("run")
            until(lambda: in_mid_bead(folder))
            time.sleep(0.05)
            yield link, folder, int(drives_of(folder)["on_at_standstill"])
        finally:
            link.close()


CLIENT = """
import sys, time
sys.path.insert(0, {here!r})
from pathlib import Path
from driver_faults import MachineLink, beads, clocked, send
folder = Path({folder!r})
link = MachineLink(folder, clocked(folder))
link.ask("enable")
send(link, beads(1, 60e-3))
link.ask("run")
time.sleep(60)
"""


def killed_client(way: signal.Signals) -> dict[str, Any]:
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
    until(lambda: (folder / "drives.json").is_file() and (folder / "ready").is_file(), 60)
    until(lambda: in_mid_bead(folder), 30)
    time.sleep(0.05)
    before = drives_of(folder)["on_at_standstill"]
    began = time.monotonic()
    os.kill(process.pid, way)
    row = settled(folder, began)
    status = StatusPage(folder).read()
    row["on_at_standstill"] -= before
    row |= {"state": status.state, "detail": status.detail}
    row["safe"] = status.state == "stopped" and not status.dispenser_on
    return row


def killed_node() -> dict[str, Any] | None:
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
        folder = Path(scratch)
        state = folder / "machine"
        given = {
            "hardware": "emulated",
            "realtime": True,
            "state_folder": str(state),
            "orphan_time": 2.0,
            "machine": str(bus_file(folder, **PATIENT)),
        }
        words = [w for k, v in given.items() for w in ("-p", f"{k}:={json.dumps(v)}")]
        command = [sys.executable, "-m", "vega_robot_driver.nodes.robot_driver", "--ros-args"]
        with (folder / "log").open("ab") as log:
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


def serial_line(misbehaviour: str) -> dict[str, Any]:
    """Let the dispenser's serial line fail in mid-bead."""
    device = MusashiDevice()
    try:
        wiring = {"axis": "x_axis", "bit": 16, "port": device.port, "dialect": "super_sigma"}
        with printing(dispenser=wiring) as (link, folder, before):
            began = time.monotonic()
            device.misbehaviour = misbehaviour
            if misbehaviour == "silent":
                row = settled(folder, began)
                row["on_at_standstill"] -= before
            else:  # it is asked again, and nothing stops
                time.sleep(1.0)
                told = drives_of(folder)["on_at_standstill"] - before
                row = {"standstill_ms": None, "valve_closed_ms": None, "on_at_standstill": told}
            status = link.status()
            row |= {"state": status.state, "detail": status.detail}
            wanted = "fault" if misbehaviour == "silent" else "printing"
            row["safe"] = status.state == wanted and device.pressure == 1300
            return row
    finally:
        device.close()


def pause() -> dict[str, Any]:
    """Pause in mid-bead."""
    with printing() as (link, folder, before):
        began = time.monotonic()
        link.ask("pause")
        row = settled(folder, began)
        row["on_at_standstill"] -= before
        return row | {"state": link.status().state, "safe": link.status().state == "paused"}


def worst(run: Callable[[], dict[str, Any]], runs: int) -> dict[str, Any]:
    """The slowest of some runs; one that the computer's stalls ended is told and left out."""
    rows, spoiled = [], 0
    row: dict[str, Any] = dict.fromkeys(("standstill_ms", "valve_closed_ms", "state"))
    row |= {"safe": False, "on_at_standstill": 0}
    while len(rows) < runs and spoiled < 2 * runs:
        try:
            row = run()
        except TimeoutError:
            spoiled += 1
            continue
        if row["safe"]:
            rows.append(row)
        else:
            spoiled += 1
    slowest = max(rows or [row], key=lambda row: row["standstill_ms"] or 0.0)
    slowest["runs"], slowest["ended_otherwise"] = len(rows), spoiled
    return slowest
