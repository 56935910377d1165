# SPDX-License-Identifier: Apache-2.0
"""What would help, by how much: a handful of changes tried on samples of the layers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import REASON_CODES, Floats, Ints, LayerStack
from vega_planner.printability.orientation import tilt_of, tilted
from vega_planner.printability.sides import SheetAssessment
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Poses the robot is asked about for each change, and those of unprintable vertices the tool
#: is held at. A numeric solver is asked about fewer.
REACH_SAMPLES, NUMERIC_SAMPLES, ACCESS_SAMPLES = 400, 120, 400

#: Changes tried: shifts along x or y [mm], turns about z [deg], limits of the tilt [deg],
#: widths of the tool, clearances [mm].
SHIFTS_MM = (20.0, 40.0, 80.0, 120.0, 160.0)
TURNS_DEG = (45.0, 90.0, 135.0, 180.0)
TILTS_DEG = (60.0, 45.0, 30.0, 15.0)
WIDTHS = (0.8, 0.6, 0.4)
CLEARANCES_MM = (0.1, 0.0)

#: A change has to win this share to be worth telling, and wins by this much over an easier one.
WORTH, MARGIN = 0.02, 0.01

#: Share of the bad vertices an angle has to let through.
MOST = 0.95

#: Clearance of poses of a sheet: number of the sheet, vertices, axes, tool, margin [mm].
Access = Callable[[int, Ints, Floats, ToolShape, float], Floats]


def reach_remedy(
    points: Floats, axes: Floats, cell: Workcell, settings: PrintabilitySettings
) -> str:
    """Find the move, turn or limit of the tilt with which most is reachable.

    Args:
        points: Tips of all layers [mm], part frame, shape (n, 3).
        axes: Unit axes of the nozzle there, shape (n, 3).
        cell: Robot and placement.
        settings: Limit of the tilt in force.

    Returns:
        The change with the share that is reachable with it and without; what does not help
        where nothing does.
    """
    from vega_planner.robot.workcell import place

    most = REACH_SAMPLES if cell.robot.closed_form is not None else NUMERIC_SAMPLES
    chosen = _evenly(len(points), most)
    points, axes = points[chosen], axes[chosen]
    x, y, z, yaw = cell.placement.pose

    def share(moved: Workcell, with_axes: Floats) -> float:
        return float(moved.reachable(points, with_axes).mean())

    def tries() -> Iterable[tuple[str, float]]:
        for shift in SHIFTS_MM:
            for dx, dy in ((shift, 0.0), (-shift, 0.0), (0.0, shift), (0.0, -shift)):
                moved = place(cell, (x + dx, y + dy, z, yaw))
                name = f"move by {dx:+g} mm in x" if dx else f"move by {dy:+g} mm in y"
                pose = f"--pose {x + dx:g},{y + dy:g},{z:g},{yaw:g}"
                yield f"{name} ({pose})", share(moved, axes)
        middle = 0.5 * (points.min(0) + points.max(0))[:2]
        for turn in TURNS_DEG:
            # about the part's middle, which stays where it is
            old, new = _turn(yaw) @ middle, _turn(yaw + turn) @ middle
            at = (x + old[0] - new[0], y + old[1] - new[1], z, yaw + turn)
            pose = ",".join(f"{round(value, 2) + 0.0:g}" for value in at)
            yield f"turn by {turn:g} deg (--pose {pose})", share(place(cell, at), axes)
        tilt = tilt_of(axes)
        for limit in TILTS_DEG:
            if limit < settings.max_tilt_deg:
                steeper = tilted(axes, np.minimum(tilt, np.radians(limit)))
                yield f"tilt by no more than {limit:g} deg (max_tilt_deg)", share(cell, steeper)

    now = share(cell, axes)
    name, best = _best(tries())
    if best < now + WORTH:
        return (
            f"{now:.0%} of the layers is reachable here, and no move by up to "
            f"{SHIFTS_MM[-1]:g} mm, turn or smaller tilt makes it more: a smaller part or a "
            "larger robot"
        )
    return f"{name}: {best:.0%} reachable instead of {now:.0%}"


def access_remedy(
    sheets: Sequence[tuple[int, Ints, Floats]],
    access: Access,
    cell: Workcell,
    settings: PrintabilitySettings,
) -> str:
    """Find a change with which the tool is clear at vertices where it is not.

    Args:
        sheets: Number of a sheet, its vertices concerned, and their axes as judged.
        access: Holds the tool there.
        cell: The tool.
        settings: Clearance and limit of the tilt in force.

    Returns:
        The change with the share of the vertices that is clear with it.
    """
    shape = ToolShape.of(cell.tool)
    total = sum(len(vertices) for _, vertices, _ in sheets)

    def share(tool: ToolShape, wanted: float, limit: float = 180.0) -> float:
        clear = 0
        for number, vertices, axes in sheets:
            turned = tilted(axes, np.minimum(tilt_of(axes), np.radians(limit)))
            clear += int((access(number, vertices, turned, tool, wanted) >= wanted).sum())
        return clear / max(total, 1)

    def tries() -> Iterable[tuple[str, float]]:
        for wanted in CLEARANCES_MM:
            if wanted < settings.clearance_mm:
                name = f"keep {wanted:g} mm clear instead of {settings.clearance_mm:g} mm"
                yield f"{name} (clearance_mm)", share(shape, wanted)
        for limit in TILTS_DEG:
            if limit < settings.max_tilt_deg:
                name = f"tilt by no more than {limit:g} deg (max_tilt_deg)"
                yield name, share(shape, settings.clearance_mm, limit)
        for width in WIDTHS:
            slim = ToolShape.of(replace(cell.tool, radius=cell.tool.radius * width))
            name = f"a tool {1 - width:.0%} slimmer (--tool)"
            yield name, share(slim, settings.clearance_mm)

    name, best = _best(tries())
    if best < WORTH:
        return (
            f"no smaller clearance, steeper nozzle or tool up to {1 - WIDTHS[-1]:.0%} slimmer "
            "clears it: split the part there, or another restraint region (--brr)"
        )
    return f"{name}: {best:.0%} of it clear"


def support_remedy(
    normals: Floats, axes: Floats, low: bool, settings: PrintabilitySettings
) -> str:
    """Find the limits that would let vertices through which lean or overhang too far.

    Args:
        normals: Unit normals of the layer there, shape (n, 3).
        axes: Unit axes of the nozzle as judged, shape (n, 3).
        low: Whether it is the underside of the part, which a restraint region facing down
            takes away.
        settings: Limits in force.
    """
    over = np.degrees(tilt_of(normals)) - 90.0
    lean = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", normals, axes), -1.0, 1.0)))
    down = float((normals[:, 2] < -0.9).mean())
    if low and down > 0.5:
        return f"a restraint region facing down (--brr down): {down:.0%} of it lies flat"
    need = (float(np.quantile(over, MOST)), float(np.quantile(lean, MOST)))
    texts = []
    if need[0] > settings.max_overhang_deg:
        texts.append(f"max_overhang_deg {min(90, int(np.ceil(need[0])))}")
    if need[1] > settings.max_lean_deg:
        texts.append(f"max_lean_deg {min(90, int(np.ceil(need[1])))}")
    if not texts or max(need) > 90.0:
        return (
            f"it overhangs by up to {max(0.0, float(over.max())):.0f} deg: a substrate under it "
            "(vega substrate), a restraint region facing down (--brr down), or the part turned "
            "over"
        )
    return (
        f"{' and '.join(texts)} instead of {settings.max_overhang_deg:g} and "
        f"{settings.max_lean_deg:g}: {MOST:.0%} of it allowed; or a substrate (vega substrate)"
    )


def remedy_of(
    code: int,
    sheets: Sequence[tuple[int, Ints]],
    stack: LayerStack,
    judged: Sequence[SheetAssessment],
    access: Access,
    cell: Workcell,
    settings: PrintabilitySettings,
) -> str:
    """Find what would help against one cause, over all the sheets it concerns.

    Args:
        code: 1 + index into `REASON_CODES`.
        sheets: Number of a sheet and the vertices concerned.
        stack: The layers.
        judged: Judgement of each sheet.
        access: Holds the tool at vertices of a sheet.
        cell: Robot, tool and placement.
        settings: The limits in force.
    """
    name = REASON_CODES[code - 1]
    every = stack.sheets
    if name in ("out_of_travel", "wrist_limit", "robot_body"):
        points = np.concatenate([sheet.vertices for sheet in every])
        axes = np.concatenate([each.outside.axes for each in judged])
        return reach_remedy(points, axes, cell, settings)
    total = sum(len(vertices) for _, vertices in sheets)
    step = max(1, -(-total // ACCESS_SAMPLES))
    some = [(n, v[::step], judged[n].outside.axes[v[::step]]) for n, v in sheets]
    if name == "no_support":
        normals = np.concatenate([every[n].vertex_normals[v] for n, v, _ in some])
        axes = np.concatenate([a for _, _, a in some])
        height = np.concatenate([every[n].vertices[v, 2] for n, v, _ in some])
        low = bool(np.median(height) < 2.0 * stack.thickness_mm)
        return support_remedy(normals, axes, low, settings)
    return access_remedy(some, access, cell, settings)


def _best(tries: Iterable[tuple[str, float]]) -> tuple[str, float]:
    """The first change of those that do about as well as the best."""
    found = list(tries)
    most = max((share for _, share in found), default=0.0)
    return next(((n, s) for n, s in found if s >= most - MARGIN), ("", 0.0))


def _evenly(count: int, most: int) -> Ints:
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _turn(deg: float) -> Floats:
    c, s = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    return np.array([[c, -s], [s, c]])
