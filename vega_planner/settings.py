# SPDX-License-Identifier: Apache-2.0
"""Settings of every stage: the only copy of each default, its unit and its reason.

`Settings` is what `plan` takes, what a settings YAML describes and what the node's
parameters are declared from. Keys in YAML are the field names, by section.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from vega_planner.errors import InvalidInput


def option(
    default: Any,
    doc: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare a settings field with its meaning and its limits.

    Args:
        default: Default value.
        doc: Meaning, unit and reason, one or two sentences.
        low: Smallest allowed value.
        high: Largest allowed value.
        choices: Allowed words.
    """
    return field(
        default=default, metadata={"doc": doc, "low": low, "high": high, "choices": choices}
    )


@dataclass(frozen=True)
class PartSettings:
    """Reading, repairing and placing a part, and its restraint region."""

    brr: tuple[str, ...] = option(
        ("auto",), "Restraint region: the union of these SPECs (see docs/restraint.md)."
    )
    unit: str = option(
        "auto",
        "Unit of the file's numbers; auto reads it from the file or takes millimetres.",
        choices=("auto", "mm", "cm", "m", "inch"),
    )
    smooth_angle_deg: float = option(
        20.0, "Largest angle between neighbouring faces of one smooth region.", low=0.0, high=180.0
    )
    edge_angle_deg: float = option(
        30.0,
        "The paper's θ_edge: faces this close to the median normal belong to the "
        "restraint region when it is handed from layer to layer.",
        low=0.0,
        high=90.0,
    )


@dataclass(frozen=True)
class LayerSettings:
    """Generation of the layers."""

    thickness_mm: float = option(0.8, "Layer thickness t [mm]; the paper's.", low=0.05, high=20.0)
    engine: str = option(
        "field",
        "field: level sets of the distance inside the part; minkowski: the paper's booleans, "
        "literal and slow; planar: flat slices, the baseline.",
        choices=("field", "minkowski", "planar"),
    )
    fill_core: bool = option(True, "Fill what remains where the last layers vanish.")


@dataclass(frozen=True)
class CellSettings:
    """The robot, its tool, and where the part stands."""

    robot: str = option(
        "vega5", "Name of a robot in config/robots, or path of a URDF or xacro file."
    )
    tool: str = option(
        "tapered_18g", "Name of a tool in config/tools, or path of a tool YAML file."
    )
    material: str = option(
        "se1700", "Name of a material in config/materials, or path of a material YAML file."
    )
    pose: str = option(
        "0,0,0,0", "X,Y,Z [mm] and YAW [deg] of the part on the build plate, or auto."
    )


@dataclass(frozen=True)
class PrintabilitySettings:
    """Reachability, access, orientation, splitting and order."""

    orientation: str = option(
        "collision-free",
        "Direction of the nozzle: normal (the paper's), vertical, or as near the normal as "
        "clearance allows.",
        choices=("normal", "vertical", "collision-free"),
    )
    max_tilt_deg: float = option(
        75.0, "Largest angle between the nozzle and the vertical [deg].", low=0.0, high=180.0
    )
    clearance_mm: float = option(
        0.2, "Distance the tool keeps from what is there [mm].", low=0.0, high=10.0
    )
    max_tilt_rate_deg_mm: float = option(
        12.0,
        "Largest change of the nozzle's tilt along the surface [deg/mm]; at 5 mm/s this "
        "stays well within the rotary axes' speed.",
        low=0.1,
        high=1000.0,
    )
    max_lean_deg: float = option(
        65.0,
        "Largest angle between the nozzle and the surface normal [deg]; beyond it the tip's "
        "edge ploughs through the bead it lays.",
        low=0.0,
        high=90.0,
    )
    max_overhang_deg: float = option(
        45.0,
        "How far a surface may lean out over what is below it and still be printed from its "
        "outer side [deg]; 0 is a vertical wall.",
        low=0.0,
        high=90.0,
    )


@dataclass(frozen=True)
class ToolpathSettings:
    """Pattern, spacing and linking of the passes."""

    width_mm: float = option(1.2, "Bead width [mm]; the paper's average.", low=0.05, high=50.0)
    pattern: str = option(
        "contour",
        "zigzag: parallel lines; contour: loops from the rim inwards; spiral: one line.",
        choices=("zigzag", "contour", "spiral"),
    )
    angle_deg: float = option(
        0.0,
        "Direction of the zigzag lines about z [deg]; alternate layers turn by 90.",
        low=-360.0,
        high=360.0,
    )
    spacing: str = option(
        "geodesic",
        "geodesic: passes keep their distance on the surface; euclidean: the paper's projected "
        "lines.",
        choices=("geodesic", "euclidean"),
    )
    link_ratio: float = option(
        2.5, "Longest link between two lines of one pass, in bead widths.", low=0.0, high=10.0
    )
    skin_overlap_ratio: float = option(
        0.15,
        "How much closer the lines of the outermost layer lie: shallower grooves on the visible "
        "surface. The layers below it give the volume.",
        low=0.0,
        high=0.3,
    )
    prime_mm: float = option(
        0.0,
        "Length of a line laid beside the part first, to fill the nozzle [mm]; 0 for none.",
        low=0.0,
        high=500.0,
    )


@dataclass(frozen=True)
class TrajectorySettings:
    """Speeds and timing."""

    speed_mm_s: float = option(
        5.0, "Speed of the tip while printing [mm/s]; the paper's.", low=0.01, high=1000.0
    )
    travel_speed_mm_s: float = option(
        40.0, "Speed of the tip between passes [mm/s].", low=0.01, high=5000.0
    )


@dataclass(frozen=True)
class Settings:
    """Everything `plan` can be told."""

    part: PartSettings = field(default_factory=PartSettings)
    layers: LayerSettings = field(default_factory=LayerSettings)
    cell: CellSettings = field(default_factory=CellSettings)
    printability: PrintabilitySettings = field(default_factory=PrintabilitySettings)
    toolpaths: ToolpathSettings = field(default_factory=ToolpathSettings)
    trajectory: TrajectorySettings = field(default_factory=TrajectorySettings)
    seed: int = option(0, "Seed of everything random.", low=0, high=2**31 - 1)
    compensate: str = option("", "Folder of an evaluation whose deviation moves the target.")

    def __post_init__(self) -> None:
        check(self)

    def updated(self, changes: dict[str, Any]) -> Settings:
        """Make a copy with some fields changed.

        Args:
            changes: Nested like the sections, e.g. `{"layers": {"thickness_mm": 0.6}}`.

        Raises:
            InvalidInput: If a key is unknown or a value out of its range.
        """
        return _updated(self, changes, "")


def _updated(section: Any, changes: dict[str, Any], prefix: str) -> Any:
    if not isinstance(changes, dict):
        raise InvalidInput(
            f"settings section '{prefix.rstrip('.')}' is {changes!r}; expected keys and values"
        )
    names = {f.name for f in fields(section)}
    new: dict[str, Any] = {}
    for key, value in changes.items():
        if key not in names:
            raise InvalidInput(f"unknown setting '{prefix}{key}'; has: {', '.join(sorted(names))}")
        old = getattr(section, key)
        if is_dataclass(old):
            new[key] = _updated(old, value, f"{prefix}{key}.")
        else:
            new[key] = _converted(f"{prefix}{key}", value, old)
    return replace(section, **new)


def _converted(name: str, value: Any, like: Any) -> Any:
    """Turn a value from YAML or the command line into the type of the default."""
    if isinstance(like, tuple):
        return (value,) if isinstance(value, str) else tuple(str(item) for item in value)
    if isinstance(like, bool):
        if not isinstance(value, bool):
            raise InvalidInput(f"setting '{name}' is {value!r}; expected true or false")
        return value
    if isinstance(like, str):
        return str(value)
    try:
        return type(like)(value)
    except (TypeError, ValueError) as error:
        kind = "a whole number" if isinstance(like, int) else "a number"
        raise InvalidInput(f"setting '{name}' is {value!r}; expected {kind}") from error


def check(section: Any, prefix: str = "") -> None:
    """Check every field of a section against its limits.

    Raises:
        InvalidInput: Naming the setting, its value and what is allowed.
    """
    for item in fields(section):
        value, name = getattr(section, item.name), f"{prefix}{item.name}"
        if is_dataclass(value):
            check(value, f"{name}.")
            continue
        low, high = item.metadata.get("low"), item.metadata.get("high")
        choices = item.metadata.get("choices") or ()
        if choices and value not in choices:
            raise InvalidInput(f"{name} is '{value}'; choices: {', '.join(choices)}")
        if low is not None and not (low <= value <= high):
            raise InvalidInput(f"{name} is {value:g}; allowed: {low:g} to {high:g}")


def load_settings(path: str | Path, base: Settings | None = None) -> Settings:
    """Read a settings YAML file over the defaults.

    Args:
        path: YAML file, sections as in `Settings`.
        base: What the file's values replace; the defaults when absent.

    Raises:
        InvalidInput: If the file cannot be read or holds an unknown key.
    """
    import yaml

    try:
        changes = yaml.safe_load(Path(path).read_text(encoding="utf-8")) or {}
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise InvalidInput(f"settings file {path} cannot be read: {reason}") from error
    return (base or Settings()).updated(changes)


def as_dict(section: Any) -> dict[str, Any]:
    """Turn settings into plain nested dictionaries, as a settings YAML holds them."""
    result: dict[str, Any] = {}
    for item in fields(section):
        value = getattr(section, item.name)
        if is_dataclass(value):
            result[item.name] = as_dict(value)
        else:
            result[item.name] = list(value) if isinstance(value, tuple) else value
    return result
