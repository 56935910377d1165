# SPDX-License-Identifier: Apache-2.0
"""EtherCAT against emulated drives: real frames over a pair of virtual network interfaces.

The process must run in a network namespace of its own (`link` starts it there), where it may
make interfaces without touching the computer's.
"""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
from pathlib import Path

from vega_planner.errors import DriverError, InvalidInput
from vega_robot_driver.emulators.faults import FAULTS
from vega_robot_driver.motion.bus_config import BusConfig
from vega_robot_driver.motion.ethercat import EthercatMotion

#: Interfaces of the two ends.
MASTER_END, SEGMENT_END = "veth_master", "veth_drives"
#: Time a frame may take through the emulator on a loaded computer [µs].
TIMEOUT_US = 200_000


class EmulatedMotion(EthercatMotion):
    """The EtherCAT axes, with the drives' process started along.

    Args:
        config: The bus.
        config_path: The file it was read from.
        status: File into which the drives write what they do.
        dt: Cycle time [s].
        by_frames: Whether each frame is a cycle of simulated time; else the clock runs.
        memory: As of `EthercatMotion`.
    """

    def __init__(
        self,
        config: BusConfig,
        config_path: str,
        status: Path,
        *,
        dt: float,
        by_frames: bool,
        memory: Path | None = None,
    ) -> None:
        timeout = TIMEOUT_US if by_frames else 10_000
        super().__init__(
            config, MASTER_END, dt=dt, timeout_us=timeout, batched=by_frames, memory=memory
        )
        self._path, self._status = config_path, status
        self._cycle = dt if by_frames else 0.0
        self._drives: subprocess.Popen | None = None
        self._commands: socket.socket | None = None

    def open(self) -> None:
        """Make the line, start the drives, bring the bus up."""
        _run("ip", "link", "add", MASTER_END, "type", "veth", "peer", "name", SEGMENT_END)
        for name in (MASTER_END, SEGMENT_END):
            _run("ip", "link", "set", name, "up")
        self._commands, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._drives = subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    "vega_robot_driver.emulators.server",
                    SEGMENT_END,
                    self._path,
                    str(self._status),
                    str(self._cycle),
                    str(theirs.fileno()),
                ],
                pass_fds=(theirs.fileno(),),
                stdout=subprocess.PIPE,
                text=True,
            )
        assert self._drives.stdout is not None
        if self._drives.stdout.readline() != "ready\n":
            raise DriverError("the emulated drives did not start; see process.log")
        super().open()

    def close(self) -> None:
        """Take the bus down and end the drives."""
        super().close()
        if self._drives is not None:
            self._drives.kill()
            self._drives.wait()

    def inject(self, fault: str) -> None:
        """Let something fail: `jam 0`, `torque_off 1`, `drive_fault 2`, `unplug 2`, ...

        Raises:
            InvalidInput: If it is not one of the faults.
        """
        kind, _, number = fault.partition(" ")
        if kind not in FAULTS or not (number or "0").isdigit():
            raise InvalidInput(f"fault '{fault}'; choices: {', '.join(FAULTS)}, and a number")
        self.tell(fault=kind, number=int(number or 0))

    def tell(self, **message: object) -> None:
        """Tell the drives' process something, and wait until it is done."""
        if self._commands is not None:
            with contextlib.suppress(OSError):
                self._commands.send(json.dumps(message).encode())
                self._commands.recv(64)


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise DriverError(f"{' '.join(command[:3])}: {done.stderr.strip() or done.returncode}")
