# SPDX-License-Identifier: Apache-2.0
"""Requests to the real-time process: one client at a time, a line of JSON each way.

The socket's name is abstract and derived from the state folder, so that nothing is left
behind and a driver that starts again finds the process that still holds the axes. When
the client's process dies, the kernel closes the socket: the other side knows at once.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vega_planner.errors import DriverError, LinkTimeout, VegaError, error_class
from vega_robot_driver.machine import Machine
from vega_robot_driver.status import MachineStatus, StatusPage

#: Time between two heartbeats [s].
BEAT_PERIOD = 0.02


def _address(folder: Path) -> str:
    name = hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:24]
    return f"\0vega-machine-{os.getuid()}-{name}"


class RequestServer:
    """The real-time process's side.

    Args:
        listening: Socket that clients connect to; it was bound by who started this process,
            which may have a network namespace of its own.
        handle: Answers a request; may raise `VegaError`.

    Attributes:
        connected: Whether a client is there.
        clients: How many came until now.
    """

    def __init__(
        self, listening: socket.socket, handle: Callable[[dict[str, Any]], dict[str, Any]]
    ) -> None:
        self._handle = handle
        self._socket = listening
        self.connected, self.clients = False, 0

    def start(self) -> None:
        """Take clients from now on."""
        threading.Thread(target=self._serve, name="requests", daemon=True).start()

    def close(self) -> None:
        """Take no more."""
        self._socket.close()

    def _serve(self) -> None:
        while True:
            try:
                client, _ = self._socket.accept()
            except OSError:
                return
            self.clients += 1
            self.connected = True
            with client, contextlib.suppress(OSError), client.makefile("rwb") as stream:
                for line in stream:
                    stream.write(json.dumps(self._answer(line)).encode() + b"\n")
                    stream.flush()
            self.connected = False

    def _answer(self, line: bytes) -> dict[str, Any]:
        try:
            return self._handle(json.loads(line))
        except VegaError as error:
            return {"error": str(error), "code": error.code}
        except Exception as error:
            return {"error": f"{type(error).__name__}: {error}", "code": 99}


class MachineLink:
    """The client's side: connects to the real-time process, starting it where it must.

    Args:
        folder: State folder; made where absent.
        machine: What to start; None only joins a process that runs.
        timeout_s: Time the process may take to come up.

    Raises:
        LinkTimeout: If it does not come up.
        DriverError: If it says why it cannot.
    """

    def __init__(self, folder: Path, machine: Machine | None, *, timeout_s: float = 20.0) -> None:
        self.folder = folder
        self.joined = False
        folder.mkdir(parents=True, exist_ok=True)
        link = self._connect()
        self.joined = link is not None
        if link is None:
            if machine is None:
                raise LinkTimeout(f"no machine runs in {folder}")
            machine.write(folder)
            link = self._start(machine.hardware, timeout_s)
        self._socket = link
        self._stream = self._socket.makefile("rwb")
        self._lock = threading.Lock()
        self._page = StatusPage(folder)
        self._page.beat()
        self._closed = threading.Event()
        threading.Thread(target=self._beat, name="heartbeat", daemon=True).start()
        if (
            self.joined
            and machine is not None
            and self.ask("hello")["hardware"] != machine.hardware
        ):
            raise DriverError(f"another kind of machine runs in {folder}; shut it down first")

    def ask(self, op: str, *, timeout_s: float = 30.0, **values: Any) -> dict[str, Any]:
        """Send a request and wait for its answer.

        Raises:
            VegaError: What the machine raised, by its error code.
            LinkTimeout: If it does not answer.
        """
        with self._lock:
            try:
                self._stream.write(json.dumps({"op": op, **values}).encode() + b"\n")
                self._stream.flush()
                ready, _, _ = select.select([self._socket], [], [], timeout_s)
                line = self._stream.readline() if ready else b""
            except (OSError, ValueError) as error:
                raise LinkTimeout(f"the real-time process is gone: {error}") from error
        if not line:
            raise LinkTimeout(f"the real-time process does not answer '{op}'")
        answer = json.loads(line)
        if "error" in answer:
            raise error_class(int(answer["code"]))(answer["error"])
        return answer

    def status(self) -> MachineStatus:
        """Read the status page."""
        return self._page.read()

    def alive(self) -> bool:
        """Tell whether the real-time process runs."""
        status = self.status()
        return status.age < 5.0 or Path(f"/proc/{status.pid}").exists()

    def close(self, *, shut_down: bool = True) -> None:
        """Leave; the process ends too, unless told to hold the axes."""
        self._closed.set()
        if shut_down:
            with contextlib.suppress(VegaError):
                self.ask("shutdown", timeout_s=5.0)
                self._socket.settimeout(5.0)
                self._stream.read(1)  # its end closes the socket
        with contextlib.suppress(OSError):
            self._stream.close()
            self._socket.close()

    def _beat(self) -> None:
        while not self._closed.wait(BEAT_PERIOD):
            self._page.beat()

    def _connect(self) -> socket.socket | None:
        link = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            link.connect(_address(self.folder))
        except OSError:
            link.close()
            return None
        return link

    def _start(self, hardware: str, timeout_s: float) -> socket.socket:
        failed = self.folder / "failed"
        failed.unlink(missing_ok=True)
        (self.folder / "ready").unlink(missing_ok=True)
        listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            listening.bind(_address(self.folder))
        except OSError as error:
            raise DriverError(f"another process drives the machine of {self.folder}") from error
        listening.listen(1)
        number = listening.fileno()
        command = [sys.executable, "-m", "vega_robot_driver", str(self.folder)]
        if hardware == "emulated":  # it makes network interfaces, in a namespace of its own
            command = ["unshare", "-n" if os.geteuid() == 0 else "-Urn", *command]
        with listening, (self.folder / "process.log").open("ab") as log:
            process = subprocess.Popen(
                [*command, str(number)],
                pass_fds=(number,),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,  # it outlives the client: it has to stop the axes
            )
        # Wait for it on a thread, so that it leaves no zombie behind.
        threading.Thread(target=process.wait, daemon=True).start()
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            if (self.folder / "ready").is_file():
                link = self._connect()
                if link is not None:
                    return link
            if failed.is_file() and (text := failed.read_text()):
                code, _, reason = text.partition(" ")
                raise error_class(int(code))(reason)
            if process.poll() is not None:
                if failed.is_file() and failed.read_text():
                    continue  # it has said why in the meantime
                raise DriverError(
                    f"the real-time process ended with {process.returncode}; "
                    f"see {self.folder / 'process.log'}"
                )
            time.sleep(0.002)
        process.kill()
        raise LinkTimeout(f"the real-time process did not come up in {timeout_s:g} s")
