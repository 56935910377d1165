# SPDX-License-Identifier: Apache-2.0
"""G-code of a filament slicer read back as beads."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.assess.beads import section_area
from vega_planner.assess.slicer_gcode import read_gcode
from vega_planner.errors import InvalidInput

#: Filament for 10 mm of bead 1.2 x 0.8.
E = float(section_area(np.array(1.2), np.array(0.8))) * 10 / (0.25 * np.pi * 1.75**2)

TEXT = f"""M83
;TYPE:Skirt
G1 X0 Y0 Z0.8 F100
G1 X50 Y0 E5
;TYPE:External perimeter
G1 X10 Y10 F7200
G1 X20 Y10 E{E:.6f} ; a comment
G1 X20 Y20 E{E:.6f}
G1 E-2
G1 X10 Y10 Z1.6
G1 E2
G1 X20 Y10 E{E:.6f}
"""


@pytest.mark.parametrize("relative", [True, False])
def test_beads_have_the_width_of_their_filament_and_lie_below_the_nozzle(tmp_path, relative):
    text = TEXT
    if not relative:
        total, lines = 0.0, []
        for line in TEXT.splitlines():
            if " E" in line:
                total += float(line.split(" E")[1].split()[0])
                line = line.split(" E")[0] + f" E{total:.6f}"
            lines.append(line.replace("M83", "M82"))
        text = "\n".join(lines)
    file = tmp_path / "a.gcode"
    file.write_text(text)
    beads = read_gcode(file, layer_height_mm=0.8)
    assert beads.length_mm == pytest.approx(30)
    assert beads.width == pytest.approx(1.2, abs=1e-4)
    assert beads.height == pytest.approx(0.8)
    assert sorted(set(beads.points[:, 2].round(6))) == [0.4, pytest.approx(1.2)]
    assert beads.points[:, :2].min(0) == pytest.approx([-5, -5])
    assert len(np.unique(beads.path_id)) == 2


def test_gcode_without_extrusion_is_refused(tmp_path):
    file = tmp_path / "a.gcode"
    file.write_text("G1 X1 Y1\n")
    with pytest.raises(InvalidInput, match="extrudes nothing"):
        read_gcode(file, layer_height_mm=0.8)
