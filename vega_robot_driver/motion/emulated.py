# SPDX-License-Identifier: Apache-2.0
"""EtherCAT against emulated drives: real frames over a pair of virtual network interfaces."""

from __future__ import annotations

from pathlib import Path

from vega_robot_driver.emulators.drives_process import MASTER_END, EmulatedDrives
from vega_robot_driver.emulators.faults import parsed
from vega_robot_driver.motion.bus_config import BusConfig
from vega_robot_driver.motion.ethercat import EthercatMotion

#: Time a frame may take through the emulator on a loaded computer [µs].
TIMEOUT_US = 200_000


class EmulatedMotion(EthercatMotion):
    """The EtherCAT axes on drives whose time is the frames'.

    Args:
        config: The bus.
        drives: The drives.
        dt: Cycle time [s].
        paced: Whether cycles come at the pace of the clock; else as fast as they can.
        memory: As of `EthercatMotion`.
    """

    waits = True

    def __init__(
        self,
        config: BusConfig,
        drives: EmulatedDrives,
        *,
        dt: float,
        paced: bool,
        memory: Path | None = None,
    ) -> None:
        super().__init__(
            config, MASTER_END, dt=dt, timeout_us=TIMEOUT_US, batched=not paced, memory=memory
        )
        self.drives = drives

    def open(self) -> None:
        """Bring the bus up as soon as the drives are there."""
        self.drives.wait_until_ready()
        super().open()

    def close(self) -> None:
        """Take the bus down and end the drives."""
        super().close()
        self.drives.stop()

    def inject(self, fault: str) -> None:
        """Let something fail: a fault and its number, see `FAULTS`.

        Raises:
            InvalidInput: If it is not one of the faults.
        """
        kind, number = parsed(fault)
        self.drives.tell(fault=kind, number=number)

    @property
    def clock_correction(self) -> float:
        """Nothing: drives whose time is the frames' are always in step."""
        return 0.0
