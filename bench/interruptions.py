# SPDX-License-Identifier: Apache-2.0
"""Prints that are interrupted at random, on drives whose time is the frames': what is laid twice?

    python bench/interruptions.py [KILLS] [SEED]

Every interruption ends a run: the process is killed (its memory is gone, its status page is
not), the power fails (the page is gone too, the disk is not), the emergency stop takes all
drives' torque, a drive trips, the line is cut behind drive 2, the client dies, or a pause is
ended by a kill. A new run takes the checkpoint
from the state folder as the driver does. What was laid is what the drives saw: where the
axes were while the valve was open.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from driver_job import PITCH, beads, bus_file, machine

from vega_robot_driver.checkpoint import read_checkpoint, write_checkpoint
from vega_robot_driver.dispenser.digital_output import DigitalOutputDispenser
from vega_robot_driver.executor import Executor
from vega_robot_driver.limits import Limits
from vega_robot_driver.motion.bus_config import read_bus_config
from vega_robot_driver.motion.direct_bus import DirectDrives, DirectMotion
from vega_robot_driver.recovery import recover_checkpoint
from vega_robot_driver.shown import Shown
from vega_robot_driver.status import StatusPage

DT, OVERLAP_S, LENGTH = 0.002, 0.1, 4e-3
KINDS = ("kill", "power", "emergency_stop", "drive_fault", "unplug", "client", "paused_kill")
#: A gap in a bead longer than this is a loss, an overlap longer than that is a bead laid
#: twice [m]: a fortieth and a quarter of the bead's width.
GAP, TWICE = 30e-6, 300e-6


class Machine:
    """The drives, and one process after the other that drives them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        path = bus_file(folder, watchdog_ms=50)
        told = machine()
        self._limits = Limits(
            *(np.array(getattr(told, k)) for k in ("lower", "upper", "velocity", "acceleration"))
        )
        config = read_bus_config(path)
        self._config = config.for_joints(told.joint_names, told.lower, told.upper, told.velocity)
        self.drives = DirectDrives(config, DT)
        self.starts = 0
        self.cycles = 0
        self.start_process()

    def start_process(self) -> None:
        """What the real-time process does when it starts."""
        recover_checkpoint(self.folder)
        motion = DirectMotion(self._config, self.drives, dt=DT, memory=self.folder)
        motion.open()
        self.executor = Executor(motion, DigitalOutputDispenser(), self._limits)
        checkpoint = self.folder / "checkpoint.json"
        self._shown = Shown(
            StatusPage(self.folder, create=True), lambda c: write_checkpoint(checkpoint, c)
        )
        self.executor.enable()
        self.starts += 1

    def kill_process(self) -> None:
        """`kill -9`: nothing is said to the drives, nothing is written."""
        self.executor.motion.abandon()
        self.drives.inject("silence 80")

    def advance(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            self.executor.advance(1)
            self._shown.show(self.executor, self.executor.cycles * DT)
        self.cycles += cycles


def interrupt(plant: Machine, kind: str, number: int) -> None:
    """Let a run end in one of the ways, and make the machine ready again."""
    executor = plant.executor
    if kind == "paused_kill" and executor.state == "printing":
        executor.pause()
        plant.advance(number % 80)
    if kind in ("kill", "power", "paused_kill"):
        plant.kill_process()
        if kind == "power":
            (plant.folder / "status").unlink()
        plant.start_process()
        return
    if kind == "client":
        executor.stop("the client is gone")
    else:
        faults = {"drive_fault": f"drive_fault {number % 5}", "unplug": "unplug 2"}
        plant.drives.inject(faults.get(kind, kind))
    plant.advance(70)
    plant.drives.inject("none")
    if executor.state == "fault":
        executor.reset_fault()
        executor.enable()


def interrupted(kills: int, seed: int) -> dict[str, Any]:
    """Print until so many interruptions have happened, and judge every print."""
    chance = np.random.default_rng(seed)
    job = beads(2, LENGTH, travel_s=0.2)
    counted = dict.fromkeys(KINDS, 0)
    lost = doubled = prints = 0
    longest_gap = longest_overlap = 0.0
    began = time.perf_counter()
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None  # no waiting for a disk
    with tempfile.TemporaryDirectory(dir=memory) as scratch:
        plant = Machine(Path(scratch))
        trace = plant.folder / "trace"
        while sum(counted.values()) < kills:
            plant.drives.tell(fault="trace", path=str(trace))
            start = 0.0
            prints += 1
            while True:
                plant.executor.load(job, start_u=start, overlap_s=OVERLAP_S)
                plant.executor.run()
                plant.advance()
                left = kills - sum(counted.values())
                cycles = int(chance.integers(1, 300)) if left else 1_000_000
                while cycles and plant.executor.state == "printing":
                    plant.advance()
                    cycles -= 1
                if plant.executor.state == "done":
                    break
                kind = str(chance.choice(KINDS))
                interrupt(plant, kind, int(chance.integers(1000)))
                counted[kind] += 1
                checkpoint = read_checkpoint(plant.folder / "checkpoint.json")
                assert checkpoint is not None
                if checkpoint.state == "done":
                    break
                checkpoint.check_resumable(job.digest(), plant.executor.motion.homing_epoch)
                start = checkpoint.done
            plant.drives.tell(fault="trace")
            gaps, overlaps = judged(np.fromfile(trace).reshape(-1, 7), 2)
            longest_gap = max(longest_gap, *gaps)
            lost += sum(gap > GAP for gap in gaps)
            doubled += sum(length > TWICE for length in overlaps)
            longest_overlap = max(longest_overlap, *overlaps, 0.0)
        plant.executor.motion.close()
    seconds = time.perf_counter() - began
    return {
        "interruptions": sum(counted.values()),
        "by_kind": counted,
        "prints": prints,
        "beads": 2 * prints,
        "beads_lost": lost,
        "beads_doubled": doubled,
        "longest_gap_mm": round(longest_gap * 1e3, 4),
        "longest_overlap_mm": round(longest_overlap * 1e3, 4),
        "process_starts": plant.starts,
        "seconds": round(seconds, 1),
        "times_real_time": round(plant.cycles * DT / seconds, 1),
    }


def judged(rows: np.ndarray, passes: int) -> tuple[list[float], list[float]]:
    """Gaps in the beads and overlaps of their pieces [m], by what the drives saw."""
    on = rows[:, 1] > 0
    edges = np.flatnonzero(np.diff(np.r_[False, on, False].astype(int))).reshape(-1, 2)
    pieces: list[list[tuple[float, float]]] = [[] for _ in range(passes)]
    for first, end in edges:
        x, y = rows[first:end, 2] * 1e-6, rows[first:end, 3] * 1e-6
        track = round(float(np.median(y)) / PITCH)
        pieces[track].append((float(x.min()), float(x.max())))
    gaps, overlaps = [], []
    for track in pieces:
        reach = 0.0
        for low, high in sorted(track):
            gaps.append(max(low - reach, 0.0))
            if reach > 0.0:
                overlaps.append(max(min(reach, high) - low, 0.0))
            reach = max(reach, high)
        gaps.append(max(LENGTH - reach, 0.0))
    return gaps, overlaps


def main(kills: int, seed: int) -> int:
    result = interrupted(kills, seed)
    print(json.dumps(result, indent=2))
    return 1 if result["beads_lost"] or result["beads_doubled"] else 0


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:3]]
    raise SystemExit(main(*numbers, *(1000, 1)[len(numbers) :]))
