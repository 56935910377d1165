# SPDX-License-Identifier: Apache-2.0
"""What is seen: part, region, layers, toolpath and robot at one time of the print."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer, Part
from vega_planner.units import m_to_mm
from vega_planner.viewer import controls as panel
from vega_planner.viewer.explain import Explanation, explain
from vega_planner.viewer.job import JobState
from vega_planner.viewer.layer_view import LayerView
from vega_planner.viewer.legend import legend
from vega_planner.viewer.path_view import BY_SPEED, PathView
from vega_planner.viewer.result_folder import ResultFolder
from vega_planner.viewer.robot_model import RobotModel
from vega_planner.viewer.robot_view import RobotView
from vega_planner.viewer.section import cut_through
from vega_planner.viewer.stage import Stage
from vega_planner.viewer.timeline import Moment, Timeline
from vega_planner.viewer.tip_speed import tip_speeds
from vega_planner.viewer.words import moment_text


class Picture:
    """The scene, kept at a time and at the choices of the panel.

    Its owner guards it against use by two threads at once.

    Attributes:
        part: The part, None before there is one.
        result: The plan that is shown, None where there is none.
        sheets: Layers that are shown: of the plan, or of a preview.
        reasons: Per sheet 0 where printable, else 1 + index into `REASON_CODES`.
        visible_layers: Indices of the layers that are shown now.
        time_s: Time of the print [s].
    """

    def __init__(self, server: Any, controls: panel.Controls) -> None:
        """Start with an empty scene.

        Args:
            server: viser's server.
            controls: What says which things are shown and how.
        """
        self._server = server
        self._controls = controls
        self._stage = Stage(server)
        self._layers = LayerView(server.scene)
        self._path = PathView(server.scene)
        self._robot = RobotView(server.scene)
        self.part: Part | None = None
        self.result: ResultFolder | None = None
        self.sheets: tuple[Layer, ...] = ()
        self.reasons: tuple[Ints, ...] = ()
        self.visible_layers: set[int] = set()
        self.time_s = 0.0

    @property
    def has_robot(self) -> bool:
        """Whether there is a robot to show."""
        return self._robot.has_robot

    @property
    def _timeline(self) -> Timeline | None:
        return self.result.timeline if self.result is not None else None

    def show_part(self, part: Part) -> None:
        """Show another part, with its region, and point the camera at it."""
        with self._server.atomic():
            self._stage.show_part(part)
            self.show_region(part)

    def show_region(self, part: Part) -> None:
        """Show the restraint region of the part."""
        self.part = part
        self._stage.show_region(part, part.restrained)

    def show_result(self, result: ResultFolder) -> None:
        """Show a plan of the part, as it is at the end of the print."""
        controls = self._controls
        with self._server.atomic():
            self.result, self.sheets, self.reasons = result, result.sheets, result.face_reasons
            if result.timeline is not None:
                self.time_s = result.timeline.duration_s
                controls.time.max = max(np.ceil(10 * self.time_s) / 10, 0.1)
                controls.time.value = controls.time.max
                controls.time.disabled = controls.play.disabled = False
            controls.show_part.value = not result.sheets
            self.redraw()

    def show_preview(self, sheets: tuple[Layer, ...]) -> None:
        """Show layers without a plan: envelopes, then cores."""
        with self._server.atomic():
            self.sheets = tuple(replace(sheet, index=n) for n, sheet in enumerate(sheets))
            self.reasons = tuple(np.zeros(len(s.faces), np.int64) for s in sheets)
            self.redraw()

    def forget_plan(self) -> None:
        """Take plan and preview away: they belong to another region."""
        controls = self._controls
        with self._server.atomic():
            self.result, self.sheets, self.reasons = None, (), ()
            controls.show_part.value = True
            controls.time.disabled = controls.play.disabled = True
            self.redraw()

    def show_robot(self, model: RobotModel, T_base_part: Floats) -> None:
        """Show a robot round the part, whose pose in its base [m] has shape (4, 4)."""
        with self._server.atomic():
            self._robot.show(model, T_base_part)
            self.refresh()

    def redraw(self) -> None:
        """Draw layers and toolpath anew, as the panel says."""
        controls, timeline = self._controls, self._timeline
        cut = cut_through(self.sheets, controls.cut.value)
        by_speed = controls.colouring.value == BY_SPEED
        with self._server.atomic():
            panel.put(controls.legend, "content", legend(self.reasons, by_speed=by_speed))
            self._layers.show(
                self.sheets,
                self.reasons,
                full_detail=controls.detail.value,
                cut=cut,
            )
            if timeline is None:
                self._path.clear()
            else:
                self._path.show(
                    timeline,
                    len(self.sheets),
                    speeds=self._speeds() if by_speed else None,
                    full_detail=controls.detail.value,
                    cut=cut,
                )
            self.refresh()

    def refresh(self, state: JobState | None = None) -> None:
        """Bring the scene up to the time and the choices of the panel.

        Args:
            state: What a running print says of its joints and its dispenser.
        """
        controls, timeline = self._controls, self._timeline
        every = {sheet.index for sheet in self.sheets}
        with self._server.atomic():
            self.visible_layers = set() if controls.layers.value == panel.NO_LAYERS else every
            if timeline is None:
                panel.put(controls.moment, "content", "")
            else:
                moment = timeline.at(self.time_s)
                self.visible_layers = self._chosen_layers(timeline, moment, every)
                this_one = controls.layers.value == panel.THIS_LAYER
                on_path = {moment.layer} if this_one else every
                self._path.set_time(moment, on_path if controls.show_path.value else set())
                self._move_robot(moment, timeline, state)
            self._layers.set_visible(self.visible_layers)
            self._robot.set_visible(controls.show_robot.value)
            shown = controls.show_part.value
            ghost = shown and bool(self.visible_layers)
            grid = not (controls.show_robot.value and self.has_robot)
            self._stage.set_visible(shown, controls.show_region.value, grid=grid, ghost=ghost)

    def explain(self, origin: Floats, direction: Floats) -> Explanation | None:
        """Say what a ray [mm, part frame] meets; None where it meets nothing."""
        part = self.part if self._controls.show_part.value else None
        summary = self.result.summary if self.result is not None else {}
        shown = [sheet for sheet in self.sheets if sheet.index in self.visible_layers]
        cut = cut_through(self.sheets, self._controls.cut.value)
        return explain(origin, direction, part, shown, self.reasons, summary, cut)

    def _chosen_layers(self, timeline: Timeline, moment: Moment, every: set[int]) -> set[int]:
        choice = self._controls.layers.value
        if choice == panel.NO_LAYERS:
            return set()
        if choice == panel.THIS_LAYER:
            return {moment.layer}
        if choice == panel.UP_TO_NOW:
            starts = timeline.layer_starts
            return {n for n in every if starts.get(n, np.inf) <= self.time_s + 1e-6}
        return every

    def _move_robot(self, moment: Moment, timeline: Timeline, state: JobState | None) -> None:
        measured = state.joints if state is not None and state.joints else moment.joints
        dispensing = state.dispensing if state is not None else moment.dispensing
        self._robot.set_joints(measured)
        self._robot.set_tip(np.array(moment.tip), np.array(moment.axis), dispensing)
        text = moment_text(moment, self.time_s, timeline.duration_s, dispensing, state)
        panel.put(self._controls.moment, "content", text)

    def _speeds(self) -> Floats | None:
        """Speed of the tip at each row of the toolpath [mm/s]; None without a trajectory."""
        timeline, result = self._timeline, self.result
        if timeline is None or result is None or len(timeline.joint_times) < 2:
            return None
        from vega_planner.robot.robot import load_robot

        robot = load_robot(result.settings.cell.robot)
        columns = [timeline.joint_names.index(name) for name in robot.joint_names]
        tips, _ = robot.forward(timeline.joint_positions[:, columns])
        return tip_speeds(
            timeline.points,
            timeline.path_id,
            m_to_mm(tips),
            timeline.joint_times,
            timeline.joint_path,
        )
