# SPDX-License-Identifier: Apache-2.0
"""The process of emulated drives, at the far end of a line of two virtual interfaces.

It is forked off before its parent loads what a master needs, so that both come up side by
side. The parent must be in a network namespace of its own (`link` starts it there), where it
may make interfaces without touching the computer's.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import traceback
from pathlib import Path

from vega_planner.errors import DriverError
from vega_robot_driver.machine import Machine
from vega_robot_driver.priority import DRIVES, claim

#: Interfaces of the two ends.
MASTER_END, SEGMENT_END = "veth_master", "veth_drives"
#: Time the drives may take to come up [s].
_COMING_UP = 30.0


class EmulatedDrives:
    """The process of the drives; it starts with this object.

    Args:
        machine: The machine they belong to.
        status: File into which they write what they do.
        strange: Descriptors of open files that are the parent's alone.

    Raises:
        DriverError: If the line cannot be made.
    """

    def __init__(self, machine: Machine, status: Path, *, strange: tuple[int, ...] = ()) -> None:
        _make_line()
        self._commands, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._pid = os.fork()
        if self._pid:
            theirs.close()
            self._commands.settimeout(_COMING_UP)
            return
        self._commands.close()
        for number in strange:
            with contextlib.suppress(OSError):
                os.close(number)
        _serve(theirs, machine, status)

    def wait_until_ready(self) -> None:
        """Wait until the drives listen.

        Raises:
            DriverError: If they do not come up.
        """
        try:
            answer = self._commands.recv(256)
        except OSError:
            answer = b""
        if answer != b"ready":
            told = answer.decode(errors="replace") or "see process.log"
            raise DriverError(f"the emulated drives did not start: {told}")

    def stop(self) -> None:
        """End the drives."""
        if self._pid:
            os.kill(self._pid, signal.SIGKILL)
            os.waitpid(self._pid, 0)
        self._pid = 0

    def tell(self, **message: object) -> None:
        """Tell the drives' process something, and wait until it is done."""
        with contextlib.suppress(OSError):
            self._commands.send(json.dumps(message).encode())
            self._commands.recv(64)


def _serve(commands: socket.socket, machine: Machine, status: Path) -> None:
    """Be the drives; does not return."""
    try:
        if machine.paced:
            claim(DRIVES)
        from vega_robot_driver.emulators.line import Line, build_segment
        from vega_robot_driver.emulators.server import Server
        from vega_robot_driver.motion.bus_config import read_bus_config

        signal.signal(signal.SIGINT, signal.SIG_IGN)
        config = read_bus_config(machine.bus_file).with_limits(
            machine.joint_names, machine.lower, machine.upper, machine.velocity
        )
        line = Line(build_segment(config), machine.dt)
        server = Server(line, SEGMENT_END, status, commands)
        commands.send(b"ready")
        server.run()
    except Exception as error:
        traceback.print_exc()
        with contextlib.suppress(OSError):
            commands.send(f"{type(error).__name__}: {error}"[:250].encode())
    finally:
        os._exit(0)


def _make_line() -> None:
    """Make the pair of interfaces, where it is not there yet."""
    lines = [
        f"link add {MASTER_END} type veth peer name {SEGMENT_END}",
        f"link set {MASTER_END} up",
        f"link set {SEGMENT_END} up",
    ]
    if MASTER_END in [name for _, name in socket.if_nameindex()]:
        return
    try:
        done = subprocess.run(
            ["ip", "-batch", "-"], input="\n".join(lines), capture_output=True, text=True
        )
    except OSError as error:
        raise DriverError(f"ip link: {error}") from error
    if done.returncode:
        raise DriverError(f"ip link: {done.stderr.strip() or done.returncode}")
