# SPDX-License-Identifier: Apache-2.0
"""The data flow, from a mesh to joint motion."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vega_planner.datatypes import (
    LayerStack,
    Part,
    Patch,
    PrintabilityReport,
    PrintTrajectory,
    ToolpathSet,
)
from vega_planner.errors import VegaError
from vega_planner.progress import Progress, Report, silent, within
from vega_planner.settings import Settings

if TYPE_CHECKING:
    from vega_planner.printability.robot_body import BodyCheck
    from vega_planner.robot.robot import Robot
    from vega_planner.robot.workcell import Workcell
    from vega_planner.toolpaths.coverage import Coverage

#: Share of the whole job's time at which each stage ends, for the progress bar.
_ENDS = {
    "part": 0.08,
    "layers": 0.38,
    "cell": 0.42,
    "printability": 0.58,
    "splitting": 0.64,
    "ordering": 0.68,
    "toolpaths": 0.76,
    "clearance": 0.84,
    "trajectory": 0.94,
    "checks": 1.0,
}

#: Code that is loaded while the layers are computed.
_LATER = (
    "clearance",
    "printability.pose",
    "printability.robot_body",
    "robot.workcell",
    "splitting",
    "substrate",
    "toolpaths.prime",
    "trajectory",
    "results.plan_folder",
)


def plan(
    part: Part | str | Path, settings: Settings | None = None, report: Report = silent
) -> PrintPlan:
    """Plan a print.

    Args:
        part: A part, or the path of a mesh file.
        settings: Everything that can be chosen; the defaults are the paper's.
        report: Told how far the job is; may raise `Cancelled` to stop it.

    Returns:
        The plan. Where some of the part cannot be printed it says so in
        `printability`, and holds what can.

    Raises:
        InvalidInput: If the mesh, the restraint region or a setting is no good.
        NoLayers: If the part yields no layer.
        Cancelled: If `report` asked to stop.
    """
    from vega_planner.layers import generate_layers
    from vega_planner.part import load_part

    settings = settings or Settings()
    stages = _Stages(report)

    with ThreadPoolExecutor(1) as beside:
        robot = beside.submit(_load_ahead, settings)
        with stages.enter("part") as tell:
            if not isinstance(part, Part):
                part = load_part(part, settings.part, tell)
            part = _compensated(part, settings)
        with stages.enter("layers") as tell:
            stack = generate_layers(
                part,
                settings.layers,
                _failing_with(robot, tell),
                edge_angle_deg=settings.part.edge_angle_deg,
            )

    from vega_planner.clearance import clear_toolpaths
    from vega_planner.ordering import order_patches
    from vega_planner.printability import assess_printability
    from vega_planner.printability.certificate import certificate
    from vega_planner.printability.collisions import (
        check_toolpaths,
        with_check,
    )
    from vega_planner.printability.link_repair import clear_motion
    from vega_planner.printability.lower_substrate import with_lower_substrate
    from vega_planner.printability.pose import choose_pose
    from vega_planner.printability.robot_body import BodyCheck, with_body
    from vega_planner.robot import load_cell
    from vega_planner.robot.placement import parse_pose
    from vega_planner.robot.workcell import place
    from vega_planner.splitting import split_layers
    from vega_planner.substrate import stand_on_substrate
    from vega_planner.toolpaths import lay_toolpaths
    from vega_planner.toolpaths.coverage import measure_coverage
    from vega_planner.toolpaths.prime import with_prime_line
    from vega_planner.trajectory import no_motion

    with stages.enter("cell"):
        cell = stand_on_substrate(load_cell(settings.cell, part, robot.result()), part)
    with stages.enter("printability") as tell:
        if parse_pose(settings.cell.pose) is None:
            cell = place(cell, choose_pose(stack, cell, settings.printability))
        assessment = assess_printability(
            stack, cell, settings.printability, tell, settings.toolpaths.width_mm
        )
        cell, assessment = with_lower_substrate(
            stack, cell, settings.printability, assessment, tell, settings.toolpaths.width_mm
        )
    with stages.enter("splitting") as tell:
        patches = split_layers(stack, assessment, cell, settings.printability, tell)
    with stages.enter("ordering") as tell:
        order = order_patches(patches, stack, cell, settings.printability, tell, assessment)
    with stages.enter("toolpaths") as tell:
        toolpaths = lay_toolpaths(order.patches, stack, cell, settings.toolpaths, tell)
    with stages.enter("clearance") as tell:
        order, toolpaths, check = clear_toolpaths(
            order, toolpaths, patches, assessment, stack, cell, settings, tell
        )
        if settings.toolpaths.prime_mm > 0:
            toolpaths = with_prime_line(
                toolpaths,
                cell,
                length_mm=settings.toolpaths.prime_mm,
                width_mm=settings.toolpaths.width_mm,
                height_mm=stack.thickness_mm,
            )
            primed = check_toolpaths(toolpaths, stack, cell, tell)
            check = replace(primed, left_out_ratio=check.left_out_ratio)
    laid, width = toolpaths, settings.toolpaths.width_mm
    with ThreadPoolExecutor(1) as beside, stages.enter("trajectory") as tell:
        filled = beside.submit(measure_coverage, order.patches, laid, stack, width)
        if toolpaths.passes:
            toolpaths, check, trajectory, body = clear_motion(
                toolpaths, check, stack, cell, settings, tell
            )
        else:  # the report says why nothing can be printed
            trajectory, body = no_motion(cell), BodyCheck()
    with stages.enter("checks"):
        proof = certificate(part, settings, cell, toolpaths, trajectory, check, body)
        coverage = filled.result()
        if toolpaths is not laid:
            coverage = measure_coverage(order.patches, toolpaths, stack, width)
    return PrintPlan(
        settings=settings,
        part=part,
        cell=cell,
        stack=stack,
        printability=with_body(with_check(order.report, check, assessment.report.reasons), body),
        patches=order.patches,
        toolpaths=toolpaths,
        trajectory=trajectory,
        coverage=coverage,
        collisions=check.summary() | body.summary(),
        certificate=proof,
        robot_body=body,
        seconds=stages.seconds,
    )


@dataclass(frozen=True, eq=False)
class PrintPlan:
    """Everything a plan consists of, stage by stage.

    Attributes:
        settings: What it was planned with.
        part: The target.
        cell: Robot, tool, material and placement.
        stack: The layers.
        printability: What can be printed and what not, and why.
        patches: What is printed, in print order.
        toolpaths: Passes and travel [mm, part frame].
        trajectory: Joint motion [SI].
        coverage: Deposited volume and what it leaves or doubles.
        collisions: Outcome of the check of every waypoint.
        certificate: Hashes of what went in and out, and the outcome of the checks.
        robot_body: Links of the robot that touch something on the way.
        seconds: Computing time of each stage.
    """

    settings: Settings
    part: Part
    cell: Workcell
    stack: LayerStack
    printability: PrintabilityReport
    patches: tuple[Patch, ...]
    toolpaths: ToolpathSet
    trajectory: PrintTrajectory
    coverage: Coverage
    collisions: dict[str, Any]
    certificate: dict[str, Any]
    robot_body: BodyCheck
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know, from every stage."""
        return (
            *self.part.warnings,
            *self.cell.warnings,
            *self.stack.warnings,
            *self.toolpaths.warnings,
            *self.trajectory.warnings,
            *self.robot_body.unread,
        )

    @property
    def prime_mm3(self) -> float:
        """Volume of the prime line [mm³], which is not part of the print."""
        from vega_planner.toolpaths.coverage import deposited_volume

        return deposited_volume(path for path in self.toolpaths.passes if path.patch < 0)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The figures of `summary.json`."""
        from vega_planner.results.summary import summarise

        return summarise(self)

    def write(self, folder: str | Path) -> Path:
        """Write the result folder, whole or not at all.

        Raises:
            OutputError: If it cannot be written.
        """
        from vega_planner.results.plan_folder import write_plan

        return write_plan(self, folder)


class _Stages:
    """Times the stages, scales their progress and marks errors with their name."""

    def __init__(self, report: Report) -> None:
        self.seconds: dict[str, float] = {}
        self._report = report
        self._start = 0.0

    @contextmanager
    def enter(self, name: str) -> Iterator[Report]:
        tell = within(self._report, name, self._start, _ENDS[name])
        self._start = _ENDS[name]
        tell(Progress(name, 0.0))
        began = time.perf_counter()
        try:
            yield tell
        except VegaError as error:
            error.stage = error.stage or name
            raise
        self.seconds[name] = time.perf_counter() - began
        tell(Progress(name, 1.0))


def _load_ahead(settings: Settings) -> Robot:
    """Load the robot and the code of the later stages; what is named wrong is found early."""
    from vega_planner.robot import load_cell

    try:
        robot = load_cell(settings.cell).robot
    except VegaError as error:
        error.stage = "cell"
        raise
    for name in _LATER:
        import_module(f"vega_planner.{name}")
    return robot


def _failing_with(robot: Future[Robot], tell: Report) -> Report:
    """Report as `tell` does, and stop as soon as the robot turns out to be wrong."""

    def both(progress: Progress) -> None:
        if robot.done():
            robot.result()
        tell(progress)

    return both


def _compensated(part: Part, settings: Settings) -> Part:
    """Move the target against a measured deviation, where one is given."""
    if not settings.compensate:
        return part
    from vega_planner.assess.compensate import compensated_part

    return compensated_part(part, Path(settings.compensate))
