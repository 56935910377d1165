# SPDX-License-Identifier: Apache-2.0
"""What has to be known of a bus: its interface, its mapping, and which drive is which axis.

Nothing is guessed: a drive's identity, scale and limits are its maker's and the machine
builder's to tell, and a file that lacks one is refused with where to find it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vega_planner.errors import InvalidInput

#: Where each required value of an axis comes from.
_SOURCES = {
    "joint": "the URDF",
    "vendor": "the drive's ESI file, or object 1018:01",
    "product": "the drive's ESI file, or object 1018:02",
    "serial": "the drive's label, or object 1018:04",
    "scale": "the drive's resolution: increments per metre or radian",
    "offset": "the machine's homing: joint position at increment 0",
    "following_error": "the machine builder: window of object 6065 in increments",
}
_BUS_SOURCES = {
    "interface": "the computer's network interface on the bus (ip link)",
    "rxpdo": "the drive's ESI file: mapping master to drive",
    "txpdo": "the drive's ESI file: mapping drive to master",
    "wrong_counters": "the machine builder: bad cycles in a row that stop the axes",
    "watchdog_ms": "the machine builder: process-data watchdog",
}
#: Objects that the driver cannot do without.
_NEEDED = {"rxpdo": (0x6040, 0x607A), "txpdo": (0x6041, 0x6064)}


@dataclass(frozen=True)
class Mapped:
    """One mapped object of the process data."""

    index: int
    sub: int
    bits: int

    @property
    def word(self) -> int:
        """The mapping entry as objects 1600 and 1A00 hold it."""
        return self.index << 16 | self.sub << 8 | self.bits


@dataclass(frozen=True)
class BusAxis:
    """One drive.

    Attributes:
        joint: Joint it moves.
        vendor: Vendor ID.
        product: Product code.
        serial: Serial number, by which it is known.
        scale: Increments per metre or radian; negative where it counts the other way.
        offset: Joint position at increment 0 [m, rad].
        following_error: Window of object 6065 [increments].
        lower: Lowest joint position [m, rad].
        upper: Highest joint position [m, rad].
        velocity: Highest joint speed [m/s, rad/s].
    """

    joint: str
    vendor: int
    product: int
    serial: int
    scale: float
    offset: float
    following_error: int
    lower: float = -1e3
    upper: float = 1e3
    velocity: float = 1.0

    def increments(self, position: float) -> int:
        """Convert a joint position [m, rad] to increments."""
        return round((position - self.offset) * self.scale)

    def position(self, increments: float) -> float:
        """Convert increments to a joint position [m, rad]."""
        return increments / self.scale + self.offset


@dataclass(frozen=True)
class BusConfig:
    """A bus.

    Attributes:
        interface: Network interface.
        wrong_counters: Wrong working counters in a row that stop all axes.
        watchdog_ms: Process-data watchdog of the drives.
        rxpdo: What the master sends each drive.
        txpdo: What each drive sends.
        axes: The drives.
        dispenser_joint: Axis whose drive has the dispenser's output, or empty.
        dispenser_bit: Bit of object 60FE:01.
    """

    interface: str
    wrong_counters: int
    watchdog_ms: int
    rxpdo: tuple[Mapped, ...]
    txpdo: tuple[Mapped, ...]
    axes: tuple[BusAxis, ...]
    dispenser_joint: str = ""
    dispenser_bit: int = 16

    def for_joints(
        self,
        names: Sequence[str],
        lower: Sequence[float],
        upper: Sequence[float],
        velocity: Sequence[float],
    ) -> BusConfig:
        """Put the axes into the order of a robot's joints, with their limits.

        Raises:
            InvalidInput: If a joint has no drive.
        """
        have = {axis.joint: axis for axis in self.axes}
        missing = [name for name in names if name not in have]
        if missing:
            raise InvalidInput(f"no axis of the bus moves {missing[0]}; has: {', '.join(have)}")
        axes = tuple(
            replace(have[name], lower=low, upper=high, velocity=speed)
            for name, low, high, speed in zip(names, lower, upper, velocity, strict=True)
        )
        return replace(self, axes=axes)


def read_bus_config(path: str | Path) -> BusConfig:
    """Read a bus file.

    Raises:
        InvalidInput: If it cannot be read or lacks something, saying where to find it.
    """
    import yaml

    if not str(path):
        raise InvalidInput(
            "hardware 'ethercat' needs a machine file (parameter 'machine'); "
            "config/machines/emulated.yaml shows one, docs/hardware.md says where its values are"
        )
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
        bus, rows = content["bus"], content["axes"]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
        raise InvalidInput(f"machine file {path} cannot be read: {error}") from error
    _require(path, "bus", bus, _BUS_SOURCES)
    for row in rows:
        _require(path, f"axis {row.get('joint', '?')}", row, _SOURCES)
    axes = tuple(BusAxis(**{key: _typed(key, row[key]) for key in _SOURCES}) for row in rows)
    serials = [axis.serial for axis in axes]
    if len(set(serials)) < len(serials):
        raise InvalidInput(f"machine file {path}: two axes have one serial number: {serials}")
    valve = content.get("dispenser") or {}
    return BusConfig(
        interface=str(bus["interface"]),
        wrong_counters=int(bus["wrong_counters"]),
        watchdog_ms=int(bus["watchdog_ms"]),
        rxpdo=_mapping(path, "rxpdo", bus["rxpdo"]),
        txpdo=_mapping(path, "txpdo", bus["txpdo"]),
        axes=axes,
        dispenser_joint=str(valve.get("axis", "")),
        dispenser_bit=int(valve.get("bit", 16)),
    )


def _require(path: str | Path, where: str, row: dict[str, Any], sources: dict[str, str]) -> None:
    for key, source in sources.items():
        if row.get(key) is None:
            raise InvalidInput(f"machine file {path}: {where} lacks '{key}' (from {source})")


def _typed(key: str, value: Any) -> Any:
    if key == "joint":
        return str(value)
    return float(value) if key in ("scale", "offset") else int(value)


def _mapping(path: str | Path, name: str, items: Sequence[str]) -> tuple[Mapped, ...]:
    try:
        mapped = tuple(
            Mapped(int(index, 16), int(sub, 16), int(bits))
            for index, sub, bits in (str(item).split(":") for item in items)
        )
    except ValueError as error:
        raise InvalidInput(
            f"machine file {path}: {name} is not index:sub:bits: {error}"
        ) from error
    for index in _NEEDED[name]:
        if index not in [item.index for item in mapped]:
            raise InvalidInput(f"machine file {path}: {name} does not map object {index:04X}")
    return mapped
