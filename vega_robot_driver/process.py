# SPDX-License-Identifier: Apache-2.0
"""The real-time process: sole owner of axes, fault latch and dispenser gate.

Runs as `python -m vega_robot_driver STATE_FOLDER SOCKET`. It keeps an absolute schedule, takes
requests from one client between cycles, and shows its state on the status page. When
the client hangs up or falls silent, it stops along the path with the dispenser off and
holds the axes: nothing outside this process is needed for that.
"""

from __future__ import annotations

import contextlib
import gc
import io
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vega_planner.errors import VegaError
from vega_robot_driver.assembly import build_executor
from vega_robot_driver.checkpoint import CheckpointWriter
from vega_robot_driver.curve import Curve
from vega_robot_driver.job import PrintJob
from vega_robot_driver.link import RequestServer
from vega_robot_driver.machine import Machine
from vega_robot_driver.operations import Operations
from vega_robot_driver.priority import CYCLE, HELPERS, claim
from vega_robot_driver.recording.ring import Ring
from vega_robot_driver.recovery import recover_checkpoint
from vega_robot_driver.schedule import MOST_OVERRUNS, Schedule
from vega_robot_driver.shown import Shown
from vega_robot_driver.status import StatusPage

if TYPE_CHECKING:
    from vega_robot_driver.emulators.drives_process import EmulatedDrives

#: Time between two wake-ups of a simulation [s].
SIMULATION_PERIOD = 0.005
#: Least silence of the client that stops a simulation faster than the clock [s].
SIMULATION_SILENCE = 0.5
#: Time after which a thread that answers requests lets the cycle go first [s].
SWITCH_INTERVAL = 0.0003


class RealTimeLoop:
    """Cycles, requests and status of one machine.

    Args:
        machine: Description of the machine.
        folder: State folder.
        listening: Socket that clients connect to.
        drives: The process of emulated drives, or None.
    """

    def __init__(
        self,
        machine: Machine,
        folder: Path,
        listening: socket.socket,
        drives: EmulatedDrives | None = None,
    ) -> None:
        self._machine, self._folder = machine, folder
        self._executor = build_executor(machine, folder, drives)
        recover_checkpoint(folder)
        self._page = StatusPage(folder, create=True)
        self._checkpoints = CheckpointWriter(folder / "checkpoint.json")
        self._shown = Shown(self._page, self._checkpoints.post)
        self._requests: queue.SimpleQueue = queue.SimpleQueue()
        self._server = RequestServer(listening, self._ask)
        self._ring = Ring(folder / "ring", create=True)
        self._recorder: subprocess.Popen | None = None
        self._had_client = False
        batched = self._executor.motion.batched
        #: A simulation that outruns the clock has no hurry, and its client shares the computer.
        self._stale = max(machine.stale_s, SIMULATION_SILENCE if batched else 0.0)
        self._quiet, self._beat, self._client = 0.0, 0, 0
        self._alone_since = time.monotonic()
        self._ended = False
        self._schedule = Schedule(machine.dt)
        self._operations = Operations(self._executor, machine, folder, self.end)

    def run(self) -> None:
        """Run until a client says to shut down, or nobody came back."""
        executor, motion = self._executor, self._executor.motion
        self._warm_up()
        try:
            motion.open()
            executor.dispenser.open()
            self._server.start()
            (self._folder / "ready").touch()
            if self._machine.record:
                self._start_recorder()
            cycles, period = 1, motion.dt
            if motion.batched:
                scale = self._machine.time_scale
                cycles = max(1, round(SIMULATION_PERIOD * scale / motion.dt))
                period = cycles * motion.dt / scale
            _raise_priority(motion.batched)
            sys.setswitchinterval(SWITCH_INTERVAL)
            gc.collect()
            gc.freeze()
            gc.disable()
            schedule = self._schedule = Schedule(period)
            self._alone_since = time.monotonic()  # bringing the bus up took its time
            while not self._ended:
                schedule.wait(motion.clock_correction)
                self._watch_schedule()
                self._watch_client()
                answers = self._handle_requests()
                executor.advance(cycles)
                self._operations.watch_calibration()
                self._record()
                self._ring.put(executor)
                for answer, value in answers:  # who got an answer finds its effect on the page
                    answer.put(value)
        finally:
            self._close()

    def end(self, *_: object) -> None:
        """Stop soon: the way out for signals."""
        self._executor.stop("the real-time process was told to end")
        self._ended = True

    def _watch_schedule(self) -> None:
        """Stop a machine whose cycles come late again and again, where the axes do not wait."""
        motion = self._executor.motion
        if self._schedule.overrun and not motion.batched and not motion.waits:
            self._executor.fail(f"{MOST_OVERRUNS} cycles in a row began late")

    def _warm_up(self) -> None:
        """Do once what is slow the first time: loading and checking a job."""
        executor = self._executor
        names = executor.motion.joint_names
        rows = np.zeros((2, len(names)))
        job = PrintJob(
            joint_names=names,
            times=np.arange(2.0),
            positions=rows,
            velocities=rows,
            extrude=np.ones(2, np.bool_),
            path_id=np.zeros(2, np.int64),
            path_layer=np.zeros(1, np.int64),
        )
        file = io.BytesIO()
        np.savez(file, rows=rows)
        file.seek(0)
        with np.load(file) as loaded:
            loaded["rows"].sum()
        job.digest()
        job.extremes(0.5)
        Curve(job.times, rows, rows).from_time(0.5)
        executor.dispenser.follow(np.zeros(1, np.bool_), executor.motion.dt)

    def _start_recorder(self) -> None:
        """Start the process that records prints; it ends when this one is gone."""
        names = self._executor.motion.joint_names
        command = [sys.executable, "-m", "vega_robot_driver.recording.recorder"]
        self._recorder = subprocess.Popen(
            ["nice", *command, str(self._folder), *names], stdin=subprocess.PIPE
        )

    # -- client -------------------------------------------------------------------------

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """Run a request between two cycles; called on the server's thread."""
        prepared = self._operations.prepare(request)
        answer: queue.SimpleQueue = queue.SimpleQueue()
        self._requests.put((prepared, answer))
        return answer.get(timeout=30.0)

    def _handle_requests(self) -> list[tuple[queue.SimpleQueue, dict[str, Any]]]:
        answers: list[tuple[queue.SimpleQueue, dict[str, Any]]] = []
        while self._server.clients == self._client:  # else the change is looked at first
            try:
                work, answer = self._requests.get_nowait()
            except queue.Empty:
                return answers
            try:
                answers.append((answer, work()))
            except VegaError as error:
                answers.append((answer, {"error": str(error), "code": error.code}))
            except Exception as error:
                text = f"unexpected {type(error).__name__}: {error}"
                answers.append((answer, {"error": text, "code": 99}))
        return answers

    def _watch_client(self) -> None:
        executor, now = self._executor, time.monotonic()
        # Another client may wait already when one goes: it is not the one who asked.
        connected, before = self._server.connected, self._client
        self._client = self._server.clients
        if connected and self._client == before:
            self._had_client, self._alone_since = True, now
            # Counted in cycles: what stalls this process too is no silence of the client.
            beat = self._page.last_beat
            self._quiet = self._quiet + self._schedule.period if beat == self._beat else 0.0
            self._beat = beat
            watched = executor.state in ("printing", "pausing", "homing")
            if watched and self._quiet > self._stale:
                executor.stop(f"the client was silent for {self._stale:g} s")
        elif self._had_client and executor.state in ("printing", "pausing", "paused", "homing"):
            executor.stop("the client is gone")
        limit = self._machine.orphan_s
        if limit and not connected and now - self._alone_since > limit and not executor.moving:
            self._ended = True

    def _record(self) -> None:
        schedule = self._schedule
        self._shown.show(
            self._executor,
            time.monotonic(),
            overruns=schedule.overruns,
            lateness=schedule.lateness,
        )

    def _close(self) -> None:
        executor = self._executor
        with contextlib.suppress(Exception):
            deadline = time.monotonic() + 5.0
            while executor.moving and time.monotonic() < deadline:
                executor.advance(1)
            executor.disable()
        for close in (executor.dispenser.close, executor.motion.close, self._server.close):
            with contextlib.suppress(Exception):
                close()
        executor.state, executor.gate, executor.pressure = "off", False, 0.0
        with contextlib.suppress(Exception):
            self._record()
        self._checkpoints.close()
        if self._recorder is not None and self._recorder.stdin is not None:
            with contextlib.suppress(OSError, subprocess.TimeoutExpired):
                self._ring.put(executor)
                self._recorder.stdin.close()
                self._recorder.wait(timeout=5.0)


def _raise_priority(batched: bool) -> None:
    """Ask for real-time scheduling where there is a bus; it may be refused.

    The threads that answer requests come below the cycle and above other processes: one of
    them that holds the interpreter's lock must not wait for a processor.
    """
    if batched:
        return
    import ctypes

    for thread in threading.enumerate():
        if thread.native_id:
            mine = thread is threading.current_thread()
            claim(CYCLE if mine else HELPERS, thread.native_id)
    with contextlib.suppress(OSError):
        ctypes.CDLL(None).mlockall(3)


def run(machine: Machine, folder: Path, listening: int, drives: EmulatedDrives | None) -> int:
    """Run the process; the exit status is 4 where the hardware failed.

    Args:
        machine: Description of the machine.
        folder: State folder.
        listening: Descriptor of the socket that clients connect to.
        drives: The process of emulated drives, or None.
    """
    failed = folder / "failed"
    try:
        loop = RealTimeLoop(machine, folder, socket.socket(fileno=listening), drives)
        signal.signal(signal.SIGTERM, loop.end)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's ctrl-c is the client's
        loop.run()
    except VegaError as error:
        failed.write_text(f"{error.code} {error}")
        return 4
    except Exception as error:
        failed.write_text(f"99 {type(error).__name__}: {error}")
        traceback.print_exc()
        return 4
    return 0
