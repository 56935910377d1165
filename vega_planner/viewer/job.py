# SPDX-License-Identifier: Apache-2.0
"""What the viewer's buttons act on: something that plans and prints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from vega_planner.errors import DriverError
from vega_planner.progress import Report
from vega_planner.settings import Settings

#: States in which a print is under way.
RUNNING = ("printing", "pausing", "paused", "stopping")


@dataclass(frozen=True)
class JobState:
    """Where a print stands.

    Attributes:
        state: "off", "idle", "printing", "pausing", "paused", "stopping", "stopped", "done" or
            "fault".
        progress: 0 to 1, by time along the path.
        path_time_s: Time along the path [s].
        time_left_s: Time the rest takes at full speed [s].
        layer: Current layer, -1 when none.
        path: Current pass, -1 on travel.
        joints: Measured joint positions [m, rad] by name; empty while unknown.
        dispensing: True while the dispenser is on.
        pressure_pa: Pressure in the barrel [Pa].
        tracking_error_m: Distance of the tip from where it was told to be [m].
        detail: A few words for a person.
    """

    state: str = "idle"
    progress: float = 0.0
    path_time_s: float = 0.0
    time_left_s: float = 0.0
    layer: int = -1
    path: int = -1
    joints: Mapping[str, float] = field(default_factory=dict)
    dispensing: bool = False
    pressure_pa: float = 0.0
    tracking_error_m: float = 0.0
    detail: str = ""


@dataclass(frozen=True)
class MachineChoice:
    """Which machine prints.

    Attributes:
        hardware: "simulated", "emulated" or "ethercat".
        pace: How much faster than the clock a simulation runs; 1 is real time.
    """

    hardware: str = "simulated"
    pace: float = 60.0


class JobPort(Protocol):
    """Plans and prints on behalf of the viewer.

    Every method may raise a `VegaError`, whose text is shown to the person.
    """

    def plan(self, mesh: Path, settings: Settings, folder: Path, report: Report) -> Path:
        """Plan a mesh into a result folder; returns when done.

        Args:
            mesh: Mesh file.
            settings: What to plan with, the restraint region included.
            folder: Result folder to write.
            report: Told how far it is; raises `Cancelled` to stop it.

        Returns:
            The folder.
        """
        ...

    def print(self, folder: Path, machine: MachineChoice) -> None:
        """Start printing a result folder; returns once the print has been accepted."""
        ...

    def pause(self) -> None:
        """Stop on the path, dispenser off; the print can go on."""
        ...

    def resume(self) -> None:
        """Go on with a paused print."""
        ...

    def stop(self) -> None:
        """End the print, dispenser off."""
        ...

    def progress(self) -> JobState:
        """Tell where the print stands; returns at once."""
        ...

    def close(self) -> None:
        """Let go of everything."""
        ...


class LocalJob:
    """Plans in this process; cannot print. For machines without ROS 2."""

    def plan(self, mesh: Path, settings: Settings, folder: Path, report: Report) -> Path:
        """Plan a mesh into a result folder."""
        from vega_planner.pipeline import plan

        return plan(mesh, settings, report).write(folder)

    def print(self, folder: Path, machine: MachineChoice) -> None:
        """Refuse: there is no robot here."""
        raise DriverError(f"printing {folder} needs ROS 2, which is not installed here")

    def pause(self) -> None:
        """Refuse: nothing prints."""
        raise DriverError("nothing is printing")

    def resume(self) -> None:
        """Refuse: nothing prints."""
        raise DriverError("nothing is printing")

    def stop(self) -> None:
        """Refuse: nothing prints."""
        raise DriverError("nothing is printing")

    def progress(self) -> JobState:
        """Tell that nothing prints."""
        return JobState("off", detail="no ROS 2 here: plans only")

    def close(self) -> None:
        """Nothing to let go of."""
