# SPDX-License-Identifier: Apache-2.0
"""What is printed, and how the dispenser has to be driven for it."""

from __future__ import annotations

from dataclasses import dataclass, fields

from vega_planner.errors import BadRobot
from vega_planner.robot.yaml_file import number, read_mapping
from vega_planner.shared_files import named_file


@dataclass(frozen=True)
class Material:
    """A material with the dispensing that was found good for it.

    Attributes:
        name: Name of the material.
        pressure_kpa: Pressure on the barrel while printing.
        speed_mm_s: Tip speed the pressure belongs to.
        bore_mm: Nozzle bore the pressure belongs to.
        layer_thickness_mm: Layer thickness the pressure belongs to.
        bead_width_mm: Bead width the pressure belongs to.
        lead_s: Time by which the pressure is switched on before a bead starts.
        lag_s: Time by which it is switched off before a bead ends.
        start_dwell_s: Time the tip waits at the start of a pass, with pressure.
        end_dwell_s: Time the tip waits at the end of a pass, without pressure.
        density_g_cm3: Density.
    """

    name: str
    pressure_kpa: float
    speed_mm_s: float
    bore_mm: float
    layer_thickness_mm: float
    bead_width_mm: float
    lead_s: float = 0.0
    lag_s: float = 0.0
    start_dwell_s: float = 0.0
    end_dwell_s: float = 0.0
    density_g_cm3: float = 1.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name != "name" and value < 0:
                raise BadRobot(f"material '{self.name}': {item.name} is {value:g}; must be >= 0")


_MAY_MISS = {
    item.name: item.default for item in fields(Material) if isinstance(item.default, float)
}


def load_material(spec: str) -> Material:
    """Read a material by name or path.

    Raises:
        InvalidInput: If there is no such material.
        BadRobot: If its file is wrong.
    """
    path = named_file("material", spec, "config", "materials")
    names = tuple(item.name for item in fields(Material))
    content = read_mapping(path, "material", names)
    where = f"material file {path}"
    values = {
        key: number(content, key, where, _MAY_MISS.get(key)) for key in names if key != "name"
    }
    return Material(name=str(content.get("name", path.stem)), **values)
