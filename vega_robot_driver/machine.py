# SPDX-License-Identifier: Apache-2.0
"""What the real-time process is told about its machine when it starts."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.errors import InvalidInput
from vega_robot_driver.dispenser.base import Dispenser
from vega_robot_driver.executor import Executor, Limits
from vega_robot_driver.motion.base import MotionController
from vega_robot_driver.motion.bus_config import DispenserWiring

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

    def write(self, folder: Path) -> None:
        """Write `machine.json`."""
        (folder / "machine.json").write_text(json.dumps(asdict(self), indent=2))


def read_machine(folder: Path) -> Machine:
    """Read `machine.json`."""
    values: dict[str, Any] = json.loads((folder / "machine.json").read_text())
    typed: Any = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    return Machine(**typed)


def build_executor(machine: Machine, folder: Path) -> Executor:
    """Build axes, dispenser and executor from a description.

    Raises:
        InvalidInput: If the description lacks something.
    """
    lower, upper, velocity = (
        np.array(values) for values in (machine.lower, machine.upper, machine.velocity)
    )
    acceleration = np.array(machine.acceleration) if machine.acceleration else None
    limits = Limits(lower, upper, velocity, acceleration)
    motion, dispenser = _devices(machine, folder)
    dispenser.set_pressure(machine.pressure_pa)
    return Executor(motion, dispenser, limits, ramp_s=machine.ramp_s)


def _devices(machine: Machine, folder: Path) -> tuple[MotionController, Dispenser]:
    from vega_robot_driver.dispenser.simulated import SimulatedDispenser

    if machine.hardware == "simulated":
        from vega_robot_driver.motion.simulated import SimulatedMotion

        motion = SimulatedMotion(
            machine.joint_names,
            np.array(machine.lower),
            np.array(machine.upper),
            np.array(machine.velocity),
            np.array(machine.start),
            dt=machine.dt,
            memory=folder / "axes.json",
        )
        return motion, SimulatedDispenser()
    from vega_robot_driver.motion.bus_config import read_bus_config

    path = machine.config
    if machine.hardware == "emulated" and not path:
        from vega_planner.shared_files import shared_file

        path = str(shared_file("config", "machines", "emulated.yaml"))
    config = read_bus_config(path).for_joints(
        machine.joint_names, machine.lower, machine.upper, machine.velocity
    )
    if machine.hardware == "emulated":
        from vega_robot_driver.motion.emulated import EmulatedDrives, EmulatedMotion

        by_frames = machine.time_scale != 1.0
        drives = EmulatedDrives(path, folder / "drives.json", machine.dt if by_frames else 0.0)
        emulated = EmulatedMotion(
            config, drives, dt=machine.dt, by_frames=by_frames, memory=folder
        )
        return emulated, _dispenser(config.dispenser)
    from vega_robot_driver.motion.ethercat import EthercatMotion

    interface = machine.interface or config.interface
    motion_on_bus = EthercatMotion(config, interface, dt=machine.dt, memory=folder)
    return motion_on_bus, _dispenser(config.dispenser)


def _dispenser(wiring: DispenserWiring) -> Dispenser:
    """Build the dispenser of a bus: its valve is wired, its pressure may have a serial line."""
    if not wiring.port:
        from vega_robot_driver.dispenser.digital_output import DigitalOutputDispenser

        return DigitalOutputDispenser()
    from vega_robot_driver.dispenser.musashi import MusashiDispenser

    return MusashiDispenser(
        wiring.port,
        baud=wiring.baud,
        channel=wiring.channel,
        dialect=wiring.dialect,
        writes=wiring.writes,
    )
