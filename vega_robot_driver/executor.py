# SPDX-License-Identifier: Apache-2.0
"""Runs a job along its path parameter.

Pause, resume, stop and speed override change the rate of the parameter within a ramp and
never the path, so that motion continues as if nothing had happened. The dispenser is on
where the job says so, the rate is above a floor, and nothing speaks against it; that is
decided here, cycle by cycle, and nowhere else.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.errors import Busy, Faulted, Refused
from vega_robot_driver.approach import joint_route
from vega_robot_driver.checkpoint import Checkpoint
from vega_robot_driver.curve import Curve
from vega_robot_driver.dispenser.base import Dispenser
from vega_robot_driver.follower import Cycles, Follower
from vega_robot_driver.job import PrintJob
from vega_robot_driver.limits import Limits
from vega_robot_driver.motion.base import MotionController
from vega_robot_driver.stall import StallWatch

#: States of the machine, in the order of their numbers on the status page.
STATES = (
    "off", "idle", "printing", "pausing", "paused", "stopping", "stopped", "done", "fault",
    "homing",
)  # fmt: skip

#: Largest distance between the axes and the path's first point at the start [m, rad].
START_TOLERANCE = 2e-3


class Executor:
    """One machine and the path it follows.

    Args:
        motion: The axes.
        dispenser: The dispenser.
        limits: What the axes may do.
        ramp_s: Time in which the rate goes from 0 to 1 and back.
    """

    def __init__(
        self,
        motion: MotionController,
        dispenser: Dispenser,
        limits: Limits,
        *,
        ramp_s: float = 0.1,
    ) -> None:
        self.motion, self.dispenser, self.limits = motion, dispenser, limits
        self._ramp_s = ramp_s
        self.state = "off"
        self.detail = ""
        self.job: PrintJob | None = None
        self.digest = ""
        self.positions = np.zeros(len(motion.joint_names))
        self.targets = self.positions.copy()
        self.gate = False
        self.pressure = 0.0
        self.cycles = 0
        self.override = 1.0
        self.start_u = 0.0
        self._follower: Follower | None = None
        self._stall = StallWatch(limits.velocity, motion.dt)

    # -- requests -----------------------------------------------------------------------

    def enable(self) -> None:
        """Power the axes and hold them.

        Raises:
            Faulted: If the machine is in its fault state, or an axis does not come up.
        """
        if self.state == "fault":
            raise Faulted(f"the machine is in its fault state: {self.detail}")
        if self.state != "off":
            return
        feedback = self.motion.enable()
        if feedback.fault:
            raise Faulted(feedback.fault)
        self.positions, self.targets = feedback.positions, feedback.positions.copy()
        self.state, self.detail = "idle", ""

    def disable(self) -> None:
        """Take the power from axes that stand still.

        Raises:
            Busy: If they move.
        """
        if self.moving or self.state == "homing":
            raise Busy("the axes move; stop first")
        self.motion.disable()
        if self.state != "fault":
            self.state = "off"

    def load(
        self,
        job: PrintJob,
        *,
        start_u: float = 0.0,
        waypoints: Floats | None = None,
        lead_s: float = 0.0,
        lag_s: float = 0.0,
        overlap_s: float = 0.0,
    ) -> None:
        """Take a job that `check_job` has passed, to be started by `run`.

        Args:
            job: The job.
            start_u: Path time from which it is printed.
            waypoints: Joint configurations to pass on the way there, shape (m, j).
            lead_s: Time by which the dispenser goes on before a bead starts.
            lag_s: Time by which it goes off before a bead ends.
            overlap_s: Time before `start_u` at which the path is joined, without
                deposition.

        Raises:
            Busy: If a job runs.
            Refused: If the axes are not powered.
        """
        if self.moving or self.state in ("printing", "pausing", "paused", "stopping"):
            raise Busy(f"job {self.digest[:12]} is {self.state}")
        if self.state in ("off", "fault", "homing"):
            raise Refused(f"the machine is {self.state} {self.detail}".rstrip())
        if not self.motion.homed:
            raise Refused("the axes are not homed: they do not know where they are")
        path = Curve(job.times, job.positions, job.velocities)
        path = path.from_time(max(start_u - overlap_s, 0.0))
        route = [self.positions, *(() if waypoints is None else waypoints), path.positions[0]]
        t, p, v = joint_route(np.array(route), self.limits.velocity)
        spans = job.intervals(lead_s=lead_s, lag_s=lag_s)
        spans = np.maximum(spans[spans[:, 1] > start_u + 1e-9], [start_u - lead_s, start_u])
        self._follower = Follower(
            Curve(t - t[-1] + path.begin, p, v),
            path,
            spans,
            done=start_u,
            dt=self.motion.dt,
            ramp_s=self._ramp_s,
            acceleration=self.limits.acceleration,
        )
        self.job, self.digest, self.start_u = job, job.digest(), start_u
        self.state, self.detail = "idle", ""

    def run(self, override: float = 1.0) -> None:
        """Start the loaded job.

        Raises:
            Refused: If none is loaded, or the axes are not where it starts.
        """
        if self._follower is None or self.state != "idle":
            raise Refused(f"nothing to start; the machine is {self.state}")
        gap = np.abs(self._follower.first - self.positions).max()
        if gap > START_TOLERANCE:
            raise Refused(f"the axes are {gap:g} from the start; allowed: {START_TOLERANCE:g}")
        self.override = min(max(override, 0.05), 1.0)
        self.state = "printing"

    def pause(self) -> None:
        """Ramp down along the path and hold; deposition goes on until standstill.

        Raises:
            Refused: If nothing runs.
        """
        if self.state not in ("printing", "pausing", "paused"):
            raise Refused(f"nothing to pause; the machine is {self.state}")
        if self.state == "printing":
            self.state, self.detail = "pausing", "paused on request"

    def resume(self) -> None:
        """Go on from where `pause` stopped.

        Raises:
            Refused: If nothing is paused.
        """
        if self.state not in ("pausing", "paused", "printing"):
            raise Refused(f"nothing to resume; the machine is {self.state}")
        self.state, self.detail = "printing", ""

    def stop(self, reason: str = "stopped on request") -> None:
        """Ramp down along the path with the dispenser off, and give the job up."""
        if self.state in ("printing", "pausing"):
            self.state, self.detail = "stopping", reason
        elif self.state == "paused":
            self.state, self.detail = "stopped", reason
        elif self.state == "homing":
            self.fail(reason)

    def home(self) -> None:
        """Home the axes that have no absolute encoder.

        Raises:
            Busy: If a job runs.
        """
        if self.moving or self.state in ("printing", "pausing", "paused", "stopping", "homing"):
            raise Busy(f"cannot home; the machine is {self.state}")
        if self.state == "fault":
            raise Refused(f"cannot home; the machine is in its fault state: {self.detail}")
        self.motion.home()
        if self.motion.homing:
            self.state, self.detail, self._follower = "homing", "", None

    def fail(self, reason: str) -> None:
        """Latch a fault: all axes stop quickly, the dispenser is off."""
        if self.state != "fault":
            self.state, self.detail, self.gate = "fault", reason, False

    def reset_fault(self) -> None:
        """Leave the fault state, without power; only on an explicit request."""
        if self.state == "fault":
            self.motion.reset_fault()
            self.dispenser.reset_fault()
            self._follower = None
            self.state, self.detail = "off", ""

    # -- cycles -------------------------------------------------------------------------

    def advance(self, cycles: int) -> None:
        """Exchange a number of cycles with the axes and the dispenser."""
        gate = np.zeros(cycles, np.bool_)
        if self.state == "fault":
            self._fault_cycles(cycles)
        elif self.state == "homing":
            self._home_cycles(cycles)
        elif self.state == "off":
            feedback = self.motion.exchange(
                np.tile(self.positions, (cycles, 1)), np.zeros((cycles, len(self.positions))), gate
            )
            self.positions = self.targets = feedback.positions
        else:
            gate = self._move(cycles)
        self.gate = bool(gate[-1]) and self.state != "fault"
        self.pressure = self.dispenser.follow(gate, self.motion.dt)
        self.cycles += cycles

    def _move(self, cycles: int) -> np.ndarray:
        """Follow the path, or hold; returns what the dispenser was told."""
        before = self.done_u
        if self._follower is None or self.state in ("idle", "stopped", "done"):
            held = np.tile(self.targets, (cycles, 1))
            u = np.full(cycles, self.u)
            off = np.zeros(cycles, np.bool_)
            asked = Cycles(held, np.zeros_like(held), off, u, np.full(cycles, before))
        else:
            want = self.override if self.state == "printing" else 0.0
            allowed = self.state in ("printing", "pausing", "paused")
            asked = self._follower.advance(cycles, want, allowed)
        gate = asked.gate.copy()
        rows = np.vstack([self.targets, asked.targets])
        wrong = self.dispenser.fault or self.limits.excess(
            rows, self.motion.joint_names, self.motion.dt
        )
        if wrong:
            self.fail(wrong)
            gate[:] = False
            self._take_back(asked, 0, before)
            self._fault_cycles(cycles)
            return gate
        feedback = self.motion.exchange(asked.targets, asked.speeds, gate)
        self.targets = asked.targets[-1].copy()
        self.positions = feedback.positions
        fault = feedback.fault or self._stalled(cycles, asked)
        if fault:
            self.fail(fault)
            good = cycles if feedback.cycles is None else feedback.cycles
            gate[good:] = False
            self._take_back(asked, good, before)
        elif self._follower is not None:
            self._reached(self._follower)
        return gate

    def _home_cycles(self, cycles: int) -> None:
        feedback = self.motion.home_cycles(cycles)
        self.positions, self.targets = feedback.positions, feedback.positions.copy()
        if feedback.fault:
            self.fail(feedback.fault)
        elif not self.motion.homing:
            self.state = "idle"

    def _stalled(self, cycles: int, asked: Cycles) -> str:
        """Say which axis stands while a bead is laid, or nothing."""
        if not asked.gate.all():
            self._stall.clear()
            return ""
        axis = self._stall.stalled(cycles, self.targets, self.positions)
        if axis < 0:
            return ""
        return f"{self.motion.joint_names[axis]} stands while a bead is laid"

    def _reached(self, follower: Follower) -> None:
        if self.state not in ("printing", "pausing", "paused", "stopping"):
            return
        if follower.ended:
            self.state, self.detail = "done", ""
        elif follower.rate == 0.0 and self.state == "pausing":
            self.state = "paused"
        elif follower.rate == 0.0 and self.state == "stopping":
            self.state = "stopped"

    def _take_back(self, asked: Cycles, good: int, before: float) -> None:
        """Forget what did not reach the axes any more."""
        if self._follower is not None:
            self._follower.rewind(asked, good, before)

    def _fault_cycles(self, cycles: int) -> None:
        for _ in range(cycles):
            feedback = self.motion.stop_quickly()
            still = not np.abs(feedback.velocities).any()
            self.positions = self.targets = feedback.positions
            if self._follower is not None:
                self._follower.rate = 0.0
            if still:
                break

    def check_job(self, job: PrintJob) -> None:
        """Check the whole of a job against the machine, before it moves.

        Raises:
            InvalidInput: If it has other joints, or leaves a limit anywhere.
        """
        self.limits.check_job(job, self.motion.joint_names, self.motion.dt)

    # -- state --------------------------------------------------------------------------

    @property
    def u(self) -> float:
        """Path time [s]; below the job's start while approaching it."""
        return self._follower.u if self._follower is not None else 0.0

    @property
    def rate(self) -> float:
        """Rate of the path time against the clock."""
        return self._follower.rate if self._follower is not None else 0.0

    @property
    def done_u(self) -> float:
        """Path time up to which everything that should be deposited is [s]."""
        return self._follower.done if self._follower is not None else 0.0

    @property
    def moving(self) -> bool:
        """Whether the path parameter moves."""
        return self.rate > 0.0

    @property
    def path(self) -> int:
        """Pass the path time is in, -1 on travel."""
        if self.job is None or self.u < self.start_u:
            return -1
        index = int(np.searchsorted(self.job.times, self.u, side="left"))
        return int(self.job.path_id[min(index, len(self.job.times) - 1)])

    @property
    def paths_done(self) -> int:
        """Number of passes completed."""
        if self.job is None:
            return 0
        return int(np.searchsorted(self.job.path_ends, self.done_u + 1e-9, side="right"))

    def checkpoint(self) -> Checkpoint:
        """What has to survive a crash."""
        return Checkpoint(
            job=self.digest,
            done=self.done_u,
            path=self.path,
            paths_done=self.paths_done,
            dispensing=self.gate,
            homing_epoch=self.motion.homing_epoch,
            state=self.state,
            reason=self.detail,
        )
