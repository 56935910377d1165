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


class EmulatedDrives:
    """The process of the drives, at the far end of the line.

    Args:
        config_path: Machine file.
        status: File into which the drives write what they do.
        cycle: Simulated time of a frame [s]; 0 where the clock runs.
    """

    def __init__(self, config_path: str, status: Path, cycle: float) -> None:
        self._path, self._status, self._cycle = config_path, status, cycle
        self._process: subprocess.Popen | None = None
        self._commands: socket.socket | None = None

    def start(self) -> None:
        """Make the line and start the drives.

        Raises:
            DriverError: If that fails.
        """
        _make_line()
        self._commands, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
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
        assert self._process.stdout is not None
        if self._process.stdout.readline() != "ready\n":
            raise DriverError("the emulated drives did not start; see process.log")

    def stop(self) -> None:
        """End the drives."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def tell(self, **message: object) -> None:
        """Tell the drives' process something, and wait until it is done."""
        if self._commands is not None:
            with contextlib.suppress(OSError):
                self._commands.send(json.dumps(message).encode())
                self._commands.recv(64)

    def inject(self, fault: str) -> None:
        """Let something fail: `jam 0`, `torque_off 1`, `drive_fault 2`, `unplug 2`, ...

        Raises:
            InvalidInput: If it is not one of the faults.
        """
        kind, _, number = fault.partition(" ")
        if kind not in FAULTS or not (number or "0").isdigit():
            raise InvalidInput(f"fault '{fault}'; choices: {', '.join(FAULTS)}, and a number")
        self.tell(fault=kind, number=int(number or 0))


class EmulatedMotion(EthercatMotion):
    """The EtherCAT axes, with the drives' process started along.

    Args:
        config: The bus.
        drives: The drives.
        dt: Cycle time [s].
        by_frames: Whether each frame is a cycle of simulated time; else the clock runs.
        memory: As of `EthercatMotion`.
    """

    def __init__(
        self,
        config: BusConfig,
        drives: EmulatedDrives,
        *,
        dt: float,
        by_frames: bool,
        memory: Path | None = None,
    ) -> None:
        super().__init__(
            config,
            MASTER_END,
            dt=dt,
            timeout_us=TIMEOUT_US if by_frames else 10_000,
            batched=by_frames,
            memory=memory,
        )
        self.drives = drives

    def open(self) -> None:
        """Start the drives and bring the bus up."""
        self.drives.start()
        super().open()

    def reopen(self) -> None:
        """Bring the bus up with drives that run."""
        super().open()

    def close(self) -> None:
        """Take the bus down and end the drives."""
        super().close()
        self.drives.stop()

    def inject(self, fault: str) -> None:
        """Let something fail, as `EmulatedDrives.inject`."""
        self.drives.inject(fault)


def _make_line() -> None:
    """Make the pair of interfaces, where it is not there yet."""
    lines = [
        f"link add {MASTER_END} type veth peer name {SEGMENT_END}",
        f"link set {MASTER_END} up",
        f"link set {SEGMENT_END} up",
    ]
    if MASTER_END in [name for _, name in socket.if_nameindex()]:
        return
    done = subprocess.run(
        ["ip", "-batch", "-"], input="\n".join(lines), capture_output=True, text=True
    )
    if done.returncode:
        raise DriverError(f"ip link: {done.stderr.strip() or done.returncode}")
