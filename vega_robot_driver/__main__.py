# SPDX-License-Identifier: Apache-2.0
"""Starts the real-time process: `python -m vega_robot_driver STATE_FOLDER SOCKET`.

Emulated drives are forked off before anything heavy is loaded: they come up while it is.
"""

from __future__ import annotations

import sys
from pathlib import Path

from vega_planner.errors import VegaError
from vega_robot_driver.machine import read_machine
from vega_robot_driver.priority import CYCLE, claim


def main() -> int:
    """Run the process; the exit status is 4 where the hardware failed."""
    folder, listening = Path(sys.argv[1]), int(sys.argv[2])
    (folder / "failed").unlink(missing_ok=True)
    drives = None
    try:
        machine = read_machine(folder)
        if machine.paced:
            claim(CYCLE)
        if machine.hardware == "emulated":
            from vega_robot_driver.emulators.drives_process import EmulatedDrives

            drives = EmulatedDrives(machine, folder / "drives.json", strange=(listening,))
        from vega_robot_driver.process import run

        return run(machine, folder, listening, drives)
    except VegaError as error:
        (folder / "failed").write_text(f"{error.code} {error}")
        return 4
    finally:
        if drives is not None:
            drives.stop()


if __name__ == "__main__":
    sys.exit(main())
