# SPDX-License-Identifier: Apache-2.0
"""Nodes in processes of their own, which end with the one that started them."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vega_planner.errors import DriverError

#: Time a node may take to end before it is killed [s].
ENDING = 10.0


class NodeProcesses:
    """The processes of the nodes.

    Args:
        processes: By name.
        logs: What each wrote.
    """

    def __init__(self, processes: dict[str, subprocess.Popen], logs: dict[str, Path]) -> None:
        self._processes, self._logs = processes, logs

    def check(self) -> None:
        """Tell when one has died.

        Raises:
            DriverError: With the last line it wrote.
        """
        for name, process in self._processes.items():
            status = process.poll()
            if status is not None:
                lines = self._logs[name].read_text(errors="replace").strip().splitlines()
                last = lines[-1] if lines else "it said nothing"
                raise DriverError(f"node {name} ended with status {status}: {last}")


def _end_with_parent() -> None:
    """Have the kernel interrupt this process when the one that started it dies."""
    import ctypes

    ctypes.CDLL(None).prctl(1, signal.SIGINT)  # PR_SET_PDEATHSIG


@contextmanager
def run_nodes(
    namespace: str, folder: Path, parameters: dict[str, dict[str, Any]]
) -> Iterator[NodeProcesses]:
    """Run nodes as processes; they are interrupted and awaited at the end.

    Args:
        namespace: Namespace of all of them.
        folder: Where their logs go.
        parameters: Parameters of each, by its module.

    Yields:
        The processes.
    """
    processes: dict[str, subprocess.Popen] = {}
    logs: dict[str, Path] = {}
    try:
        for module, values in parameters.items():
            name = module.rsplit(".", 1)[-1]
            command = [sys.executable, "-m", module, "--ros-args", "-r", f"__ns:={namespace}"]
            for key, value in values.items():
                command += ["-p", f"{key}:={json.dumps(value)}"]
            logs[name] = folder / f"{name}.log"
            with logs[name].open("wb") as log:
                processes[name] = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,  # ctrl-c is handled here, goal by goal
                    preexec_fn=_end_with_parent,
                )
        yield NodeProcesses(processes, logs)
    finally:
        for process in processes.values():
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)
        for process in processes.values():
            try:
                process.wait(timeout=ENDING)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
