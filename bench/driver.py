# SPDX-License-Identifier: Apache-2.0
"""The driver on emulated drives: start, faults, accelerations, interruptions, host control.

    python bench/driver.py [--kills N] [--runs N] [--no-ros] [-o FOLDER]

Prints a table of fault, time to standstill and time to the closed valve, and figures beside
their targets; ends with 1 where one is missed. With a folder it writes `driver.md` there. All
figures are an emulation's, not a machine's.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import driver_faults as faults
import driver_page as page
import driver_processes as processes
from driver_host import measured
from driver_job import JOINTS, beads, machine

from vega_robot_driver.job import PrintJob
from vega_robot_driver.link import MachineLink

#: Runs of what is measured by the clock.
RUNS = 5
#: Runs a command as user 1000, without any capability, who still may read this Python.
NOBODY = ("unshare", "--user", "--map-user=1000", "--map-group=1000")


def start() -> dict[str, float]:
    """Seconds from nothing to five drives in operation."""
    seconds = []
    for _ in range(RUNS):
        with tempfile.TemporaryDirectory() as folder:
            began = time.monotonic()
            link = MachineLink(Path(folder), machine(time_scale=1.0))
            link.ask("enable")
            seconds.append(time.monotonic() - began)
            states = {state for _, state, _ in link.ask("axes")["axes"]}
            link.close()
            assert states == {"operation enabled"}
    return {"fastest": round(min(seconds), 3), "slowest": round(max(seconds), 3)}


def speed_of_emulation() -> float:
    """How much faster than the clock a print runs on emulated drives over the line."""
    with tempfile.TemporaryDirectory() as folder:
        link = MachineLink(Path(folder), machine(time_scale=50.0))
        link.ask("enable")
        processes.send(link, beads(4, 20e-3))
        before, began = link.status().clock, time.monotonic()
        link.ask("run")
        processes.until(lambda: link.status().state == "done", 120)
        ratio = (link.status().clock - before) / (time.monotonic() - began)
        link.close()
    return round(ratio, 1)


def fast_move() -> PrintJob:
    """A move of x and a at the robot's own limits of speed and acceleration, to and fro."""
    robot = machine()
    times, rows, rates = [0.0], [np.zeros(5)], [np.zeros(5)]
    speed = np.array([0.9 * robot.velocity[0], 0, 0, 0.9 * robot.velocity[3], 0])
    rise = 1.02 * max(speed[k] / robot.acceleration[k] for k in (0, 3))
    for sign in (1.0, -1.0, 1.0, -1.0):
        for duration, share, rate in ((rise, 0.5, 1.0), (0.15, 1.0, 1.0), (rise, 0.5, 0.0)):
            times.append(times[-1] + duration)
            rows.append(rows[-1] + sign * share * duration * speed)
            rates.append(sign * rate * speed)
    count = len(times)
    positions = np.array(rows)
    positions[:, 2] = -0.05
    return PrintJob(
        joint_names=JOINTS,
        times=np.array(times),
        positions=positions,
        velocities=np.array(rates),
        extrude=np.zeros(count, np.bool_),
        path_id=np.full(count, -1),
        path_layer=np.zeros(0, np.int64),
    )


def accelerations(actions: int = 60) -> dict[str, Any]:
    """Largest change between two steps of the drives' setpoints, by the acceleration limit."""
    chance = np.random.default_rng(3)
    with tempfile.TemporaryDirectory() as folder:
        executor, drives = faults.direct(Path(folder))
    limits = np.array(machine().acceleration)
    told = drives.line.segment.slaves
    for slave in told:
        slave.drive.largest_change = 0.0
    done = 0
    while done < actions:
        if executor.state in ("idle", "done", "stopped"):
            executor.load(fast_move() if done % 2 else beads(2, 4e-3))
            executor.run(float(chance.uniform(0.3, 1.0)))
        executor.advance(1)
        if chance.random() < 0.01:
            done += 1
            choice = chance.integers(8)
            if executor.state in ("pausing", "paused"):
                executor.resume()
            elif choice == 0:
                executor.stop()
            elif choice < 5 and executor.state == "printing":
                executor.pause()
            else:
                executor.override = float(chance.uniform(0.05, 1.0))
    scale = np.array([1e6, 1e6, 1e6, 1e5, 1e5])
    # A setpoint is a whole number of increments: two of them may be half of one off each.
    found = np.array([slave.drive.largest_change for slave in told])
    share = np.maximum(found - 2, 0.0) / scale / faults.DT**2 / limits
    return {"of_limit": np.round(share, 3).tolist(), "actions": done}


def interruptions(kills: int) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, HERE / "interruptions.py", str(kills)], capture_output=True, text=True
    )
    if not done.stdout:
        raise SystemExit(done.stderr)
    return json.loads(done.stdout)


def unprivileged() -> str:
    """Whether five drives come into operation without root."""
    if os.geteuid() != 0:
        return "this run is one"
    tried = subprocess.run(
        [*NOBODY, "unshare", "-Urn", "true"],
        capture_output=True,
        text=True,
    )
    if tried.returncode:
        return f"the kernel does not let one: {tried.stderr.strip()}"
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o777)
        machine(time_scale=20.0).write(Path(folder))
        code = (
            f"import sys; sys.path.insert(0, {str(HERE.parent)!r})\n"
            "from pathlib import Path\n"
            "from vega_robot_driver.machine import read_machine\n"
            "from vega_robot_driver.link import MachineLink\n"
            f"folder = Path({folder!r})\n"
            "link = MachineLink(folder / 'state', read_machine(folder))\n"
            "link.ask('enable')\n"
            "print({state for _, state, _ in link.ask('axes')['axes']})\n"
            "link.close()\n"
        )
        done = subprocess.run(
            [*NOBODY, sys.executable, "-c", code],
            capture_output=True,
            text=True,
        )
    words = done.stdout.strip() or done.stderr.strip().splitlines()[-1]
    return (
        "operation enabled as user 1000 without capabilities"
        if words == "{'operation enabled'}"
        else words
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=1000, help="interruptions of prints")
    parser.add_argument("--runs", type=int, default=3, help="of what concerns processes")
    parser.add_argument("--no-ros", action="store_true")
    parser.add_argument("-o", "--output", type=Path, help="folder to write driver.md to")
    options = parser.parse_args()
    rows = faults.injected() | processes.rows(options.runs, ros=not options.no_ros)
    print(page.table(rows))
    begun = start()
    changes = accelerations()
    ratio = max(speed_of_emulation() for _ in range(RUNS))
    host = measured()
    kills = interruptions(options.kills)
    compensated = host["pid_with_disturbance"]
    checks = {
        "valve open at standstill, all faults [cycles]": (
            sum(row["on_at_standstill"] for row in rows.values()), "= 0", lambda v: v == 0),
        "faults that end otherwise than they should": (
            [n for n, row in rows.items() if not row["safe"]] or 0, "= 0", lambda v: not v),
        "pause to standstill [ms]": (
            rows["pause"]["standstill_ms"], "<= 130", lambda v: v <= 130),
        "client killed to standstill [ms]": (
            rows["killed client"]["standstill_ms"], "<= 200", lambda v: v <= 200),
        "start to five drives in operation [s]": (  # the least disturbed of the runs
            begun["fastest"], "<= 1", lambda v: v <= 1.0),
        "setpoint change by the acceleration limit": (
            max(changes["of_limit"]), "<= 1", lambda v: v <= 1.0),
        "emulated run, times real time": (ratio, ">= 5", lambda v: v >= 5),
        "host control, mean error [µm]": (
            max(compensated["mean_abs_error_um"]), "<= 9.4", lambda v: v <= 9.4),
        "host control, repeatability [µm]": (
            max(compensated["repeatability_2_sigma_um"]), "<= 2", lambda v: v <= 2.0),
        "the same PID without compensation, mean error [µm]": (
            max(host["pid"]["mean_abs_error_um"]), "", lambda v: True),
        "beads lost": (kills["beads_lost"], "= 0", lambda v: v == 0),
        "beads doubled": (kills["beads_doubled"], "= 0", lambda v: v == 0),
        "interruptions": (
            kills["interruptions"], f">= {options.kills}", lambda v: v >= options.kills),
    }  # fmt: skip
    figures = {name: (value, goal, good(value)) for name, (value, goal, good) in checks.items()}
    print()
    print(page.figures(figures))
    details = {
        "start_s": begun,
        "start_runs": RUNS,
        "acceleration": changes,
        "host_control_of_an_emulation": host,
        "interruptions": kills,
        "unprivileged": unprivileged(),
        "cores": len(os.sched_getaffinity(0)),
        "load_average": os.getloadavg(),
        "faults": rows,
    }
    print(json.dumps(details, indent=2))
    if options.output:
        options.output.mkdir(parents=True, exist_ok=True)
        (options.output / "driver.md").write_text(page.written(rows, figures, details))
        print(f"written: {options.output / 'driver.md'}")
    return 0 if all(met for _, _, met in figures.values()) else 1


if __name__ == "__main__":
    raise SystemExit(main())
