# SPDX-License-Identifier: Apache-2.0
"""What the real-time process is told about its machine when it starts."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from vega_planner.errors import InvalidInput

HARDWARE = ("simulated", "emulated", "ethercat")


@dataclass(frozen=True)
class Machine:
    """A machine's description, kept as `machine.json` in the state folder.

    Attributes:
        hardware: "simulated", "emulated" or "ethercat".
        joint_names: Names of the axes.
        lower: Lowest joint positions [m, rad].
        upper: Highest joint positions [m, rad].
        velocity: Highest joint speeds [m/s, rad/s].
        start: Positions of simulated axes at their first start.
        acceleration: Highest joint accelerations [m/s², rad/s²], or empty where unknown.
        dt: Cycle time [s].
        time_scale: How much faster than the clock a simulation runs.
        ramp_s: Time in which the path rate goes from 0 to 1 and back.
        stale_s: Silence of the client after which the machine stops.
        orphan_s: Time without a client after which a standing machine ends; 0 for never.
        pressure_pa: Supply pressure of the dispenser [Pa].
        config: Path of the machine's bus configuration, where it has a bus.
        interface: Network interface of the bus, over the configuration's; or empty.
        record: Whether every print is recorded, in `recordings` of the state folder.
    """

    hardware: str
    joint_names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    velocity: tuple[float, ...]
    start: tuple[float, ...]
    acceleration: tuple[float, ...] = ()
    dt: float = 0.002
    time_scale: float = 500.0
    ramp_s: float = 0.1
    stale_s: float = 0.1
    orphan_s: float = 30.0
    pressure_pa: float = 130e3
    config: str = ""
    interface: str = ""
    record: bool = True

    def __post_init__(self) -> None:
        if self.hardware not in HARDWARE:
            raise InvalidInput(f"hardware is '{self.hardware}'; choices: {', '.join(HARDWARE)}")
        for name in ("dt", "time_scale", "ramp_s", "stale_s"):
            if not getattr(self, name) > 0:
                raise InvalidInput(f"{name} is {getattr(self, name):g}; must be above 0")

    @property
    def paced(self) -> bool:
        """Whether cycles come at the pace of the clock."""
        return self.hardware == "ethercat" or self.time_scale == 1.0

    @property
    def bus_file(self) -> str:
        """Path of the machine file; the shipped one where emulated drives are given none."""
        if self.config or self.hardware != "emulated":
            return self.config
        from vega_planner.shared_files import shared_file

        return str(shared_file("config", "machines", "emulated.yaml"))

    def write(self, folder: Path) -> None:
        """Write `machine.json`."""
        (folder / "machine.json").write_text(json.dumps(asdict(self), indent=2))


def read_machine(folder: Path) -> Machine:
    """Read `machine.json`."""
    values: dict[str, Any] = json.loads((folder / "machine.json").read_text())
    typed: Any = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    return Machine(**typed)
