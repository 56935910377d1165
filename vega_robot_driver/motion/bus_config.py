# SPDX-License-Identifier: Apache-2.0
"""What has to be known of a bus: its interface, its mapping, and which drive is which axis.

Nothing is guessed: a drive's identity, scale and limits are its maker's and the machine
builder's to tell, and a file that lacks one is refused with where to find it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from vega_planner.errors import InvalidInput

#: Where each required value of an axis comes from.
_SOURCES = {
    "joint": "the URDF",
    "vendor": "the drive's ESI file, or object 1018:01",
    "product": "the drive's ESI file, or object 1018:02",
    "serial": "the drive's label, or object 1018:04; or give 'alias', from its EEPROM",
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
#: What may be left out.
_BUS_CHOICES = ("control", "distributed_clocks", "sync_error_limit")
_AXIS_CHOICES = ("alias", "homing", "host", "emulated")
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
class Homing:
    """How a drive finds its reference (CiA 402-2, homing mode).

    Attributes:
        method: Object 6098.
        speed: Speed of the search for the switch [increments/s], object 6099:01.
        slow: Speed of the search for zero [increments/s], object 6099:02.
        acceleration: Object 609A [increments/s²].
        offset: Object 607C: position at home [increments].
        timeout_s: Time homing may take.
    """

    method: int
    speed: int
    slow: int
    acceleration: int
    offset: int
    timeout_s: float = 60.0


@dataclass(frozen=True)
class HostAxis:
    """What closing an axis's loop in the computer takes. SI: N and kg, or Nm and kg m².

    Attributes:
        mass: Moved mass or inertia.
        rated: Force at 1000 per mille of object 6071.
        kp: Force by position error [N/m].
        ki: Force by its integral [N/(m s)].
        kd: Force by the error of the speed [N s/m].
        most: Largest force.
    """

    mass: float
    rated: float
    kp: float
    ki: float
    kd: float
    most: float


@dataclass(frozen=True)
class BusAxis:
    """One drive.

    Attributes:
        joint: Joint it moves.
        vendor: Vendor ID.
        product: Product code.
        serial: Serial number, by which it is known; 0 where it is known by its alias.
        scale: Increments per metre or radian; negative where it counts the other way.
        offset: Joint position at increment 0 [m, rad].
        following_error: Window of object 6065 [increments].
        lower: Lowest joint position [m, rad].
        upper: Highest joint position [m, rad].
        velocity: Highest joint speed [m/s, rad/s].
        homing: How it finds its reference; None where its encoder is absolute.
        host: What closing its loop in the computer takes; None where the drive closes it.
        alias: Station alias in its EEPROM, by which it is known instead; or 0.
        emulated: Forces that an emulated drive has to overcome, by name, or empty.
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
    homing: Homing | None = None
    host: HostAxis | None = None
    alias: int = 0
    emulated: Mapping[str, float] = field(default_factory=dict)

    @property
    def known_by(self) -> tuple[str, int]:
        """What it is known by: "alias" or "serial", and its number."""
        return ("alias", self.alias) if self.alias else ("serial", self.serial)

    def increments(self, position: float) -> int:
        """Convert a joint position [m, rad] to increments."""
        return round((position - self.offset) * self.scale)

    def position(self, increments: float) -> float:
        """Convert increments to a joint position [m, rad]."""
        return increments / self.scale + self.offset


@dataclass(frozen=True)
class DispenserWiring:
    """How the dispenser is connected: a wired start signal, and a serial line if it has one.

    Attributes:
        axis: Axis whose drive has the output that opens the valve, or empty.
        bit: Bit of object 60FE:01.
        port: Serial port of a Musashi dispenser, or empty.
        baud: Bits a second.
        channel: Channel whose parameters are used.
        dialect: Family of its commands.
        writes: Whether parameters may be set; only after a person has tried it.
        shot_s: Time of the shots [s] that the serial line starts where no wire does; 0 where
            one does. The output then is to cut the air.
    """

    axis: str = ""
    bit: int = 16
    port: str = ""
    baud: int = 9600
    channel: int = 1
    dialect: str = "super_sigma"
    writes: bool = False
    shot_s: float = 0.0


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
        dispenser: How the dispenser is connected.
        control: "drive" where the drives close the loops, "host" where the computer does.
        distributed_clocks: "auto" to use them where every drive has them, "on" or "off".
        sync_error_limit: Object 10F1:02 of the drives, or 0 where they have none.
    """

    interface: str
    wrong_counters: int
    watchdog_ms: int
    rxpdo: tuple[Mapped, ...]
    txpdo: tuple[Mapped, ...]
    axes: tuple[BusAxis, ...]
    dispenser: DispenserWiring = field(default_factory=lambda: DispenserWiring())
    control: str = "drive"
    distributed_clocks: str = "auto"
    sync_error_limit: int = 0

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
        limited = self.with_limits(names, lower, upper, velocity)
        have = {axis.joint: axis for axis in limited.axes}
        missing = [name for name in names if name not in have]
        if missing:
            raise InvalidInput(f"no axis of the bus moves {missing[0]}; has: {', '.join(have)}")
        return replace(self, axes=tuple(have[name] for name in names))

    def with_limits(
        self,
        names: Sequence[str],
        lower: Sequence[float],
        upper: Sequence[float],
        velocity: Sequence[float],
    ) -> BusConfig:
        """Give the axes that move a robot's joints their limits, in the order they have."""
        rows = zip(names, lower, upper, velocity, strict=True)
        limits = {name: (low, high, speed) for name, low, high, speed in rows}
        axes = []
        for axis in self.axes:
            low, high, speed = limits.get(axis.joint, (axis.lower, axis.upper, axis.velocity))
            axes.append(replace(axis, lower=low, upper=high, velocity=speed))
        return replace(self, axes=tuple(axes))


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
    _only(path, "the file", content, ("bus", "dispenser", "axes"))
    _only(path, "bus", bus, (*_BUS_SOURCES, *_BUS_CHOICES))
    _require(path, "bus", bus, _BUS_SOURCES)
    for row in rows:
        where = f"axis {row.get('joint', '?')}"
        _only(path, where, row, (*_SOURCES, *_AXIS_CHOICES))
        if row.get("alias") and row.get("serial"):
            raise InvalidInput(f"machine file {path}: {where} has 'serial' and 'alias'; give one")
        _require(path, where, {"serial": 0, **row} if row.get("alias") else row, _SOURCES)
    axes = tuple(_axis(path, row) for row in rows)
    for axis in axes:
        if [other.known_by for other in axes].count(axis.known_by) > 1:
            kind, number = axis.known_by
            raise InvalidInput(f"machine file {path}: two axes have {kind} {number}")
    config = BusConfig(
        interface=str(bus["interface"]),
        wrong_counters=int(bus["wrong_counters"]),
        watchdog_ms=int(bus["watchdog_ms"]),
        rxpdo=_mapping(path, "rxpdo", bus["rxpdo"]),
        txpdo=_mapping(path, "txpdo", bus["txpdo"]),
        axes=axes,
        dispenser=_part(path, "dispenser", DispenserWiring, content.get("dispenser") or {}),
        control=_choice(path, "control", bus.get("control", "drive"), ("drive", "host")),
        distributed_clocks=_choice(
            path,
            "distributed_clocks",
            bus.get("distributed_clocks", "auto"),
            ("auto", "on", "off"),
        ),
        sync_error_limit=int(bus.get("sync_error_limit", 0)),
    )
    _check_wiring(path, config)
    return config


def _axis(path: str | Path, row: dict[str, Any]) -> BusAxis:
    where = f"axis {row['joint']}"
    homing, host = row.get("homing"), row.get("host")
    return BusAxis(
        **{key: _typed(key, row.get(key, 0)) for key in (*_SOURCES, "alias")},
        homing=_part(path, f"{where}: homing", Homing, homing) if homing else None,
        host=_part(path, f"{where}: host", HostAxis, host) if host else None,
        emulated={key: float(value) for key, value in (row.get("emulated") or {}).items()},
    )


def _part(path: str | Path, where: str, kind: type, row: dict[str, Any]) -> Any:
    """Build a part of the file; every key must be one of its fields."""
    _only(path, where, row, [item.name for item in fields(kind)])
    try:
        return kind(**row)
    except TypeError as error:
        raise InvalidInput(f"machine file {path}: {where}: {error}") from error


def _only(path: str | Path, where: str, row: dict[str, Any], names: Sequence[str]) -> None:
    """Refuse keys that are not known."""
    for key in row:
        if key not in names:
            raise InvalidInput(
                f"machine file {path}: {where} has no '{key}'; choices: {', '.join(names)}"
            )


def _choice(path: str | Path, name: str, value: Any, choices: tuple[str, ...]) -> str:
    word = {True: "on", False: "off"}.get(value, value)  # YAML reads on and off as booleans
    if word not in choices:
        raise InvalidInput(
            f"machine file {path}: {name} is '{value}'; choices: {', '.join(choices)}"
        )
    return str(word)


def _check_wiring(path: str | Path, config: BusConfig) -> None:
    """Refuse what cannot work together."""
    joints = [axis.joint for axis in config.axes]
    if config.dispenser.axis and config.dispenser.axis not in joints:
        raise InvalidInput(
            f"machine file {path}: the dispenser hangs on axis '{config.dispenser.axis}'; "
            f"has: {', '.join(joints)}"
        )
    if config.dispenser.shot_s and not config.dispenser.port:
        raise InvalidInput(f"machine file {path}: the dispenser has 'shot_s' and no 'port'")
    homed = [axis.joint for axis in config.axes if axis.homing is not None]
    if homed and 0x6060 not in [item.index for item in config.rxpdo]:
        raise InvalidInput(
            f"machine file {path}: {homed[0]} is homed by its drive; rxpdo must map object 6060"
        )
    if config.control == "host":
        for axis in config.axes:
            if axis.host is None:
                raise InvalidInput(
                    f"machine file {path}: control 'host', and axis {axis.joint} lacks 'host' "
                    "(mass, rated, kp, ki, kd, most: from data sheet and commissioning)"
                )
        for index in (0x6060, 0x6071):
            if index not in [item.index for item in config.rxpdo]:
                raise InvalidInput(
                    f"machine file {path}: control 'host', and rxpdo does not map object "
                    f"{index:04X}"
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
