# SPDX-License-Identifier: Apache-2.0
"""Puts a machine together from its description: axes, dispenser, executor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.errors import InvalidInput
from vega_robot_driver.dispenser.base import Dispenser
from vega_robot_driver.executor import Executor
from vega_robot_driver.limits import Limits
from vega_robot_driver.machine import Machine
from vega_robot_driver.motion.base import MotionController

if TYPE_CHECKING:
    from vega_robot_driver.emulators.drives_process import EmulatedDrives
    from vega_robot_driver.motion.bus_config import DispenserWiring


def build_executor(
    machine: Machine, folder: Path, drives: EmulatedDrives | None = None
) -> Executor:
    """Build axes, dispenser and executor from a description.

    Args:
        machine: The description.
        folder: State folder.
        drives: The process of emulated drives, where the hardware is emulated.

    Raises:
        InvalidInput: If the description lacks something.
    """
    lower, upper, velocity = (
        np.array(values) for values in (machine.lower, machine.upper, machine.velocity)
    )
    acceleration = np.array(machine.acceleration) if machine.acceleration else None
    limits = Limits(lower, upper, velocity, acceleration)
    motion, dispenser = _devices(machine, folder, drives)
    dispenser.set_pressure(machine.pressure_pa)
    return Executor(motion, dispenser, limits, ramp_s=machine.ramp_s)


def _devices(
    machine: Machine, folder: Path, drives: EmulatedDrives | None
) -> tuple[MotionController, Dispenser]:
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

    config = read_bus_config(machine.bus_file).for_joints(
        machine.joint_names, machine.lower, machine.upper, machine.velocity
    )
    if machine.hardware == "emulated":
        from vega_robot_driver.motion.emulated import EmulatedMotion

        if drives is None:
            raise InvalidInput("hardware 'emulated' needs the process of its drives")
        emulated = EmulatedMotion(
            config, drives, dt=machine.dt, paced=machine.paced, memory=folder
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
        shot_s=wiring.shot_s,
    )
