# SPDX-License-Identifier: Apache-2.0
"""The viewer: one picture and one panel, shared by all tabs, and what presses lead to."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Part
from vega_planner.errors import InvalidInput, VegaError
from vega_planner.units import m_to_mm, mm_to_m
from vega_planner.viewer import controls as panel
from vega_planner.viewer.job import JobPort, JobState, MachineChoice
from vega_planner.viewer.job_desk import JobDesk
from vega_planner.viewer.picture import Picture
from vega_planner.viewer.pointer import watch_pointer
from vega_planner.viewer.region_desk import RegionDesk
from vega_planner.viewer.result_folder import ResultFolder, read_result
from vega_planner.viewer.robot_model import read_robot_model
from vega_planner.viewer.settings_panel import SettingsPanel
from vega_planner.viewer.target import Target
from vega_planner.viewer.words import result_text, status_text

#: How often playback and the print's progress are shown [s].
TICK_S = 0.1
#: The robot is drawn so long after somebody sees the part, or at the latest after so long [s].
ROBOT_AFTER_S, ROBOT_AT_LATEST_S = 1.0, 5.0


class Viewer:
    """One person's, or several people's, view of a part and its print.

    Attributes:
        target: What is looked at.
        controls: The panel.
        picture: The scene.
        region: The restraint region and the settings.
        jobs: Planning and printing.
    """

    def __init__(self, server: Any, target: Target, make_job: Callable[[], JobPort]) -> None:
        """Build the panel; `load` brings the picture.

        Args:
            server: viser's server.
            target: What to show.
            make_job: Makes what plans and prints, on first use.
        """
        self._server = server
        self._lock = threading.RLock()
        self._closing = threading.Event()
        self._remark = ""
        self.target = target
        self.controls = panel.Controls(server, str(target.out))
        with self.controls.settings_tab:
            fields = SettingsPanel(server.gui, target.own_settings, self._settings_changed)
        self.picture = Picture(server, self.controls)
        self.region = RegionDesk(target, self.controls, self.picture, fields, self._lock)
        self.jobs = JobDesk(make_job)
        watch_pointer(server.gui, self._rested)
        self._connect()
        self._ticker = threading.Thread(target=self._tick_on, daemon=True, name="viewer")
        self._ticker.start()

    @property
    def part(self) -> Part | None:
        """The part, with its restraint region."""
        return self.picture.part

    @property
    def result(self) -> ResultFolder | None:
        """The plan that is shown."""
        return self.picture.result

    # ---- what is shown

    def load(self) -> None:
        """Read the target and show it; the robot follows.

        Raises:
            VegaError: If the target cannot be read.
        """
        if self.target.is_result:
            self._show_result(read_result(self.target.path))
        else:
            from vega_planner.part import load_part

            part = load_part(self.target.path, self.target.settings.part)
            self._remark = self.region.take_part(part)
        threading.Thread(target=self._load_the_rest, daemon=True, name="robot").start()

    def close(self) -> None:
        """End the threads and let go of the job."""
        self._closing.set()
        self.region.give_up_preview()
        self._ticker.join(timeout=2)
        self.jobs.close()

    def set_time(self, time_s: float, state: JobState | None = None) -> None:
        """Show the print at a time.

        Args:
            time_s: Time from the start [s].
            state: What a running print says of its joints and its dispenser.
        """
        with self._lock:
            self.picture.time_s = time_s
            self.picture.refresh(state)

    def _show_result(self, result: ResultFolder) -> None:
        controls = self.controls
        with self._lock, self._server.atomic():
            self._remark = self.region.take_part(result.part)
            self.picture.show_result(result)
            controls.result.content = result_text(result.summary)
            controls.click.value = panel.EXPLAIN
            self.region.say("Rest the pointer on a layer: what it is, and what is wrong.")

    def _load_the_rest(self) -> None:
        """Bring what nobody misses at first: the robot, and the icons of the buttons."""
        began = time.monotonic()
        while not self._is_seen() and time.monotonic() - began < ROBOT_AT_LATEST_S:
            if self._closing.wait(0.1):
                return
        self._closing.wait(ROBOT_AFTER_S)
        from vega_planner.robot.description import load_description

        result = self.result
        try:
            if result is not None:
                name, T_base_part = result.settings.cell.robot, result.T_base_part
            else:
                from vega_planner.robot.workcell import load_cell

                settings = self.target.settings.cell
                cell = load_cell(settings, self.part)
                name, T_base_part = settings.robot, cell.placement.T_base_part
            model = read_robot_model(load_description(name).urdf)
        except VegaError as error:
            self._remark = f"no robot is shown: {error}"
            return
        with self._lock:
            self.picture.show_robot(model, T_base_part)
        self.controls.add_icons()

    def _is_seen(self) -> bool:
        """Whether some browser has drawn a picture."""
        try:
            clients = self._server.get_clients().values()
            return any(client.camera.update_timestamp > 0 for client in clients)
        except AssertionError:  # it has not told of its camera yet
            return False

    # ---- what is pressed

    def _connect(self) -> None:
        controls, picture, region = self.controls, self.picture, self.region
        self._server.scene.on_click()(self._clicked)
        self._by_person(controls.time, lambda: self.set_time(controls.time.value))
        for handle in (
            controls.show_part, controls.show_region, controls.show_robot, controls.show_path,
            controls.layers,
        ):  # fmt: skip
            self._by_person(handle, self._locked(picture.refresh))
        for handle in (controls.cut, controls.detail, controls.colouring):
            self._by_person(handle, self._locked(picture.redraw))
        self._by_person(controls.preview, region.preview_again)
        self._by_person(controls.out, region.show_command)
        for button, action in (
            (controls.use_specs, region.use_specs),
            (controls.clear, region.clear),
            (controls.plan, self.start_plan),
            (controls.print, self.start_print),
            (controls.pause, lambda: self.jobs.job.pause()),
            (controls.resume, lambda: self.jobs.job.resume()),
            (controls.stop, self.jobs.stop),
        ):
            self._on_press(button, action)

    def _by_person(self, handle: Any, action: Callable[[], None]) -> None:
        """Act on what a person changes, not on what this program sets."""

        @handle.on_update
        def _(event: Any) -> None:
            if event.client_id is not None:
                self._guarded(action, event.client)

    def _on_press(self, button: Any, action: Callable[[], None]) -> None:
        @button.on_click
        def _(event: Any) -> None:
            self._guarded(action, event.client)

    def _guarded(self, action: Callable[[], None], client: Any) -> None:
        try:
            action()
        except VegaError as error:
            self.tell("This cannot be done", str(error), client)

    def _locked(self, action: Callable[[], None]) -> Callable[[], None]:
        def run() -> None:
            with self._lock:
                action()

        return run

    def _settings_changed(self) -> None:
        self._guarded(self.region.settings_changed, None)

    def _clicked(self, event: Any) -> None:
        origin = m_to_mm(np.array(event.ray_origin, dtype=np.float64))
        direction = np.array(event.ray_direction, dtype=np.float64)
        self._guarded(lambda: self.click(origin, direction, event.client), event.client)

    def click(self, origin: Floats, direction: Floats, client: Any = None) -> None:
        """Act on a click: pick, or explain.

        Args:
            origin: Start of the ray [mm], part frame.
            direction: Its direction.
            client: Who clicked.

        Raises:
            VegaError: If the pick leaves nothing to envelop.
        """
        if self.controls.click.value == panel.EXPLAIN:
            self._explain(origin, direction, client)
        else:
            self.region.click(origin, direction)

    def _rested(self, origin: Floats, direction: Floats, client: Any) -> None:
        if self.controls.click.value == panel.EXPLAIN:
            self._explain(m_to_mm(origin), direction, client)

    def _explain(self, origin: Floats, direction: Floats, client: Any) -> None:
        found = self.picture.explain(origin, direction)
        if found is not None:
            self.region.say(found.text)
        if client is None:
            return
        if found is None:
            client.scene.remove_by_name("/pointed")
        else:
            place = mm_to_m(np.array(found.point))
            client.scene.add_label("/pointed", found.label, position=place)

    def start_plan(self) -> None:
        """Plan what is chosen into the result folder.

        Raises:
            VegaError: If a setting is no good, or a job is running.
        """
        settings = self.region.settings()
        folder = Path(self.controls.out.value).expanduser().absolute()
        self.jobs.start_plan(
            self.target.source,
            settings,
            folder,
            lambda done: self._show_result(read_result(done)),
            lambda reason: self.tell("Not planned", reason, None),
        )
        self.region.give_up_preview()

    def start_print(self) -> None:
        """Print the plan that is shown.

        Raises:
            VegaError: If there is none, or the robot refuses it.
        """
        if self.result is None:
            raise InvalidInput("there is no plan to print; press Plan first")
        controls = self.controls
        controls.play.value = False
        machine = MachineChoice(controls.hardware.value, float(controls.machine_pace.value[1:]))
        self.jobs.start_print(self.result.path, machine)

    # ---- what goes on

    def _tick_on(self) -> None:
        last = time.monotonic()
        while not self._closing.wait(TICK_S):
            now = time.monotonic()
            try:
                self._tick(now - last)
            except VegaError as error:
                self._remark = str(error)
            last = now

    def _tick(self, elapsed: float) -> None:
        controls, jobs = self.controls, self.jobs
        was_running = jobs.running
        jobs.look()
        state = jobs.state
        if jobs.running or (was_running and state.state == "done"):
            with self._server.atomic():
                self.set_time(state.path_time_s, state)
                shown = round(min(state.path_time_s, controls.time.max), 1)
                panel.put(controls.time, "value", shown)
        elif controls.play.value and self.result is not None:
            self._play(elapsed)
        share = state.progress if jobs.running else jobs.progress if jobs.planning else 0.0
        panel.put(controls.bar, "value", round(100.0 * share, 1))
        controls.show_buttons(
            state.state,
            planning=jobs.planning,
            can_plan=jobs.idle and self.part is not None,
            can_print=jobs.idle and self.result is not None,
        )
        people = len(self._server.get_clients())
        remark = jobs.remark or self._remark
        text = status_text(self.target.name, jobs.planning, state, remark, people)
        panel.put(controls.status, "content", text)

    def _play(self, elapsed: float) -> None:
        controls = self.controls
        pace = float(controls.play_speed.value[1:])
        after = min(self.picture.time_s + pace * elapsed, controls.time.max)
        with self._server.atomic():
            self.set_time(after)
            controls.time.value = round(after, 1)
            if after >= controls.time.max:
                controls.play.value = False

    def tell(self, title: str, body: str, client: Any) -> None:
        """Show a message to one person, or to all where none is given."""
        clients = [client] if client is not None else self._server.get_clients().values()
        for one in clients:
            one.add_notification(title, body, auto_close_seconds=12.0, color="orange")
