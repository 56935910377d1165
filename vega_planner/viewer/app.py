# SPDX-License-Identifier: Apache-2.0
"""The viewer: what is shown, and what happens on a click. One scene, shared by all tabs."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer, LayerStack, Part
from vega_planner.errors import Cancelled, InvalidInput, VegaError
from vega_planner.progress import Progress
from vega_planner.settings import Settings
from vega_planner.units import m_to_mm, mm_to_m
from vega_planner.viewer import controls as panel
from vega_planner.viewer.command import needs_file, plan_command, save_settings
from vega_planner.viewer.explain import explain
from vega_planner.viewer.job import JobPort, JobState, MachineChoice
from vega_planner.viewer.layer_view import CUTS, LayerView
from vega_planner.viewer.path_view import PathView
from vega_planner.viewer.picking import first_hit
from vega_planner.viewer.pointer import watch_pointer
from vega_planner.viewer.preview import Preview
from vega_planner.viewer.restraint_picks import RestraintPicks
from vega_planner.viewer.result_folder import ResultFolder, read_result
from vega_planner.viewer.robot_model import read_robot_model
from vega_planner.viewer.robot_view import RobotView
from vega_planner.viewer.settings_panel import SettingsPanel
from vega_planner.viewer.stage import Stage
from vega_planner.viewer.target import Target
from vega_planner.viewer.words import moment_text, result_text, status_text

#: How often playback and the print's progress are shown [s].
TICK_S = 0.1
#: The robot is drawn this long after the part [s].
ROBOT_AFTER_S = 1.5
#: States of a print during which its progress leads the picture.
RUNNING = ("printing", "pausing", "paused", "stopping")


class Viewer:
    """One person's, or several people's, view of a part and its print."""

    def __init__(self, server: Any, target: Target, make_job: Callable[[], JobPort]) -> None:
        """Build the panel; `load` brings the picture.

        Args:
            server: viser's server.
            target: What to show.
            make_job: Makes what plans and prints, on first use.
        """
        self.target = target
        self.controls = panel.Controls(server, str(target.out))
        self.stage = Stage(server)
        self.layer_view = LayerView(server.scene)
        self.path_view = PathView(server.scene)
        self.robot_view = RobotView(server.scene)
        self.part: Part | None = None
        self.result: ResultFolder | None = None
        self.picks: RestraintPicks | None = None
        self.state = JobState()
        self.planning = False
        self.starting = False
        self._server = server
        self._make_job = make_job
        self._job: JobPort | None = None
        self._sheets: tuple[Layer, ...] = ()
        self._reasons: tuple[Ints, ...] = ()
        self._base = target.settings
        self._settings_file = target.settings_file
        self._source = target.path / "part.ply" if target.is_result else target.path
        self._time_s = 0.0
        self._visible: set[int] = set()
        self._remark = ""
        self._cancel = threading.Event()
        self._closing = threading.Event()
        self._lock = threading.RLock()
        self._preview = Preview(self._show_preview, self._say_at_pointer)
        with self.controls.settings_tab:
            self.settings_panel = SettingsPanel(server.gui, self._base, self._settings_changed)
        watch_pointer(server.gui, self._rested)
        self._connect()
        self._ticker = threading.Thread(target=self._tick_on, daemon=True, name="viewer")
        self._ticker.start()

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

            self._show_part(load_part(self.target.path, self._base.part), keep_specs=True)
        threading.Thread(target=self._load_robot, daemon=True, name="robot").start()

    def close(self) -> None:
        """End the threads and let go of the job."""
        self._closing.set()
        self._cancel.set()
        self._preview.cancel()
        self._ticker.join(timeout=2)
        if self._job is not None:
            self._job.close()

    def set_time(self, time_s: float, state: JobState | None = None) -> None:
        """Show the print at a time.

        Args:
            time_s: Time from the start [s].
            state: What a running print says of its joints and its dispenser.
        """
        with self._lock:
            self._time_s = time_s
            self._refresh(state)

    @property
    def visible_layers(self) -> set[int]:
        """Indices of the layers that are shown."""
        return set(self._visible)

    def _show_part(self, part: Part, *, keep_specs: bool) -> None:
        faces_file = Path(f"{self.controls.out.value}.faces.txt").absolute()
        settings = self._base.part
        specs = part.brr if keep_specs else ()
        try:
            picks = RestraintPicks(part, settings, faces_file, specs, part.restrained)
        except VegaError as error:
            # The region is known face by face, but its SPECs name files that have gone.
            self._remark = str(error)
            picks = RestraintPicks(part, settings, faces_file)
        with self._lock, self._server.atomic():
            self.part, self.picks = part, picks
            self.stage.show_part(part)
            self._show_region()
            self._refresh()

    def _show_region(self) -> None:
        if self.part is None or self.picks is None:
            return
        chosen = self.picks.faces
        self.part = replace(self.part, restrained=chosen, brr=self.picks.specs)
        self.stage.show_region(self.part, chosen)
        self.controls.specs.value = " ".join(self.picks.specs)
        self._show_command()

    def _show_result(self, result: ResultFolder) -> None:
        controls = self.controls
        self._base = _settings_of(result, self._base)
        self.settings_panel.show(self._base)
        self._show_part(result.part, keep_specs=True)
        with self._lock, self._server.atomic():
            self.result = result
            self._sheets, self._reasons = result.sheets, result.face_reasons
            self._draw_layers()
            self._draw_paths()
            controls.result.content = result_text(result.summary)
            controls.click.value = panel.EXPLAIN
            controls.pointed.content = (
                "Rest the pointer on a layer: what it is, and what is wrong."
            )
            controls.show_part.value = not result.sheets
            if result.timeline is not None:
                self._time_s = result.timeline.duration_s
                controls.time.max = max(np.ceil(10 * self._time_s) / 10, 0.1)
                controls.time.value = controls.time.max
                controls.time.disabled = controls.play.disabled = False
            self._refresh()

    def _show_preview(self, stack: LayerStack) -> None:
        with self._lock, self._server.atomic():
            self._sheets = stack.sheets
            self._reasons = tuple(np.zeros(len(s.faces), np.int64) for s in stack.sheets)
            self.controls.cut.value = CUTS[2]
            self._draw_layers()
            self._refresh()
        self._say_at_pointer(f"{len(stack.layers)} layers, {len(stack.cores)} core layers.")

    def _draw_layers(self) -> None:
        controls = self.controls
        self.layer_view.show(
            self._sheets,
            self._reasons,
            full_detail=controls.detail.value,
            cut=controls.cut.value,
        )

    def _draw_paths(self) -> None:
        if self.result is None or self.result.timeline is None:
            self.path_view.clear()
            return
        self.path_view.show(
            self.result.timeline,
            len(self._sheets),
            colouring=self.controls.colouring.value,
            full_detail=self.controls.detail.value,
        )

    def _refresh(self, state: JobState | None = None) -> None:
        """Bring the scene up to the time and the choices of the panel."""
        controls = self.controls
        timeline = self.result.timeline if self.result is not None else None
        every = {sheet.index for sheet in self._sheets}
        with self._server.atomic():
            choice = controls.layers.value
            self._visible = set() if choice == panel.NO_LAYERS else every
            if timeline is None:
                _set(controls.moment, "content", "")
            else:
                moment = timeline.at(self._time_s)
                if choice == panel.THIS_LAYER:
                    self._visible = {moment.layer}
                elif choice == panel.UP_TO_NOW:
                    starts = timeline.layer_starts
                    self._visible = {
                        n for n in every if starts.get(n, np.inf) <= self._time_s + 1e-6
                    }
                on_path = {moment.layer} if choice == panel.THIS_LAYER else every
                self.path_view.set_time(moment, on_path if controls.show_path.value else set())
                measured = state.joints if state is not None and state.joints else moment.joints
                dispensing = state.dispensing if state is not None else moment.dispensing
                self.robot_view.set_joints(measured)
                self.robot_view.set_tip(np.array(moment.tip), np.array(moment.axis), dispensing)
                text = moment_text(moment, self._time_s, timeline.duration_s, dispensing, state)
                _set(controls.moment, "content", text)
            self.layer_view.set_visible(self._visible)
            self.robot_view.set_visible(controls.show_robot.value)
            part_shown = controls.show_part.value
            ghost = part_shown and bool(self._visible)
            self.stage.set_visible(part_shown, controls.show_region.value, ghost)

    def _load_robot(self) -> None:
        # The part comes first: what the robot needs to be read would hold its picture up.
        self._closing.wait(ROBOT_AFTER_S)
        from vega_planner.robot.description import load_description

        result, name = self.result, self._base.cell.robot
        try:
            if result is not None:
                name = str(result.summary.get("robot", name))
                T_base_part = result.T_base_part
            else:
                from vega_planner.robot.workcell import load_cell

                cell = load_cell(self._base.cell, self.part)
                T_base_part = cell.placement.T_base_part
            model = read_robot_model(load_description(name).urdf)
        except VegaError as error:
            self._remark = f"no robot is shown: {error}"
            return
        with self._lock, self._server.atomic():
            self.robot_view.show(model, T_base_part)
            self._refresh()

    # ---- what is clicked

    def _connect(self) -> None:
        controls = self.controls
        self._server.scene.on_click()(self._clicked)
        self._by_person(controls.time, lambda: self.set_time(controls.time.value))
        for handle in (
            controls.show_part, controls.show_region, controls.show_robot, controls.show_path,
            controls.layers,
        ):  # fmt: skip
            self._by_person(handle, self._locked(self._refresh))
        for handle in (controls.cut, controls.detail):
            self._by_person(handle, self._locked(self._redraw))
        self._by_person(controls.colouring, self._locked(self._redraw))
        self._by_person(controls.preview, self._preview_again)
        self._by_person(controls.out, self._show_command)
        for button, action in (
            (controls.use_specs, self._use_specs),
            (controls.clear, self._clear_region),
            (controls.plan, self.start_plan),
            (controls.print, self.start_print),
            (controls.pause, lambda: self.job.pause()),
            (controls.resume, lambda: self.job.resume()),
            (controls.stop, self.stop),
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

    def _redraw(self) -> None:
        with self._server.atomic():
            self._draw_layers()
            self._draw_paths()
            self._refresh()

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
        mode = self.controls.click.value
        if mode == panel.EXPLAIN:
            self._explain(origin, direction, client)
            return
        if self.part is None or self.picks is None:
            return
        hit = first_hit(origin, direction, self.part.vertices, self.part.faces)
        if hit is None:
            return
        with self._lock:
            toggle = (
                self.picks.toggle_face if mode == panel.PICK_FACE else self.picks.toggle_region
            )
            self.controls.pointed.content = toggle(hit)
        self._region_changed()

    def _rested(self, origin: Floats, direction: Floats, client: Any) -> None:
        if self.controls.click.value == panel.EXPLAIN:
            self._explain(m_to_mm(origin), direction, client)

    def _explain(self, origin: Floats, direction: Floats, client: Any) -> None:
        part = self.part if self.controls.show_part.value else None
        summary = self.result.summary if self.result is not None else {}
        found = explain(
            origin, direction, part, self._sheets, self._reasons, self._visible, summary
        )
        if found is None:
            if client is not None:
                client.scene.remove_by_name("/pointed")
            return
        self.controls.pointed.content = found.text
        if client is not None:
            place = mm_to_m(np.array(found.point))
            client.scene.add_label("/pointed", found.label, position=place)

    def _use_specs(self) -> None:
        if self.picks is not None:
            with self._lock:
                self.picks.set_specs(tuple(self.controls.specs.value.split()))
            self._region_changed()

    def _clear_region(self) -> None:
        if self.picks is not None:
            with self._lock:
                self.picks.clear()
            self._region_changed()

    def _region_changed(self) -> None:
        with self._lock, self._server.atomic():
            # What was planned or previewed belongs to another region.
            self.result, self._sheets, self._reasons = None, (), ()
            self.layer_view.clear()
            self.path_view.clear()
            self.controls.show_part.value = True
            self.controls.time.disabled = self.controls.play.disabled = True
            self._show_region()
            self._refresh()
        self._preview.cancel()
        if self.controls.preview.value and self.part is not None:
            self._say_at_pointer("Working the layers out.")
            self._preview.request(self.part, self.settings())

    def _preview_again(self) -> None:
        """Work the layers out anew, unless a whole plan is shown."""
        self._preview.cancel()
        if self.result is None:
            self._region_changed()

    def _settings_changed(self) -> None:
        self._guarded(self._show_command, None)
        self._guarded(self._preview_again, None)

    # ---- planning and printing

    @property
    def job(self) -> JobPort:
        """What plans and prints; made on first use."""
        with self._lock:
            if self._job is None:
                self._job = self._make_job()
            return self._job

    def settings(self) -> Settings:
        """Everything the panel says, the restraint region included.

        Raises:
            InvalidInput: If a value is out of its range.
        """
        return self.settings_panel.settings(self.picks.specs if self.picks else ("none",))

    def start_plan(self) -> None:
        """Plan in a thread of its own.

        Raises:
            VegaError: If a setting is no good.
        """
        if self.planning or self.starting or self.state.state in RUNNING:
            raise InvalidInput("a job is running; stop it first")
        settings = self.settings()
        folder = Path(self.controls.out.value).expanduser().absolute()
        self._preview.cancel()
        self._cancel.clear()
        self.planning = True
        threading.Thread(
            target=self._plan, args=(settings, folder), daemon=True, name="plan"
        ).start()

    def _plan(self, settings: Settings, folder: Path) -> None:
        said = 0.0

        def report(progress: Progress) -> None:
            nonlocal said
            if self._cancel.is_set():
                raise Cancelled("stopped; nothing was written")
            if time.monotonic() - said > TICK_S:
                said = time.monotonic()
                self.controls.bar.value = 100.0 * progress.fraction
                layers = f", {progress.layers} layers" if progress.layers else ""
                self._remark = f"planning: {progress.stage} {progress.detail}{layers}"

        try:
            source = self._source.absolute()
            done = self.job.plan(source, settings, folder, report)
            self._show_result(read_result(done))
            self._remark = ""
        except VegaError as error:
            stage = f" ({error.stage})" if error.stage else ""
            self._remark = f"not planned{stage}: {error}"
            self.tell("Not planned", str(error), None)
        finally:
            self.controls.bar.value = 0.0
            self.planning = False

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
        if self.planning or self.starting or self.state.state in RUNNING:
            raise InvalidInput("a job is running; stop it first")
        self.starting, self._remark = True, "starting the print"
        try:
            self.job.print(self.result.path.absolute(), machine)
        finally:
            self.starting, self._remark = False, ""

    def stop(self) -> None:
        """Stop planning or printing."""
        if self.planning:
            self._cancel.set()
            return
        self.job.stop()

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
        controls = self.controls
        was = self.state.state
        if self._job is not None:
            self.state = self._job.progress()
        state = self.state
        running = state.state in RUNNING
        if running or (was in RUNNING and state.state == "done"):
            with self._server.atomic():
                self.set_time(state.path_time_s, state)
                _set(controls.time, "value", round(min(state.path_time_s, controls.time.max), 1))
                _set(controls.bar, "value", round(100.0 * state.progress, 1))
        elif controls.play.value and self.result is not None:
            pace = float(controls.play_speed.value[1:])
            after = min(self._time_s + pace * elapsed, controls.time.max)
            with self._server.atomic():
                self.set_time(after)
                controls.time.value = round(after, 1)
                if after >= controls.time.max:
                    controls.play.value = False
        self._update_buttons(running)
        people = len(self._server.get_clients())
        text = status_text(self.target.name, self.planning, state, self._remark, people)
        _set(controls.status, "content", text)

    def _update_buttons(self, running: bool) -> None:
        controls, state = self.controls, self.state.state
        idle = not self.planning and not self.starting and not running
        for button, visible in (
            (controls.plan, idle and self.part is not None),
            (controls.print, idle and self.result is not None),
            (controls.pause, state == "printing"),
            (controls.resume, state == "paused"),
            (controls.stop, self.planning or running),
        ):
            _set(button, "visible", visible)

    # ---- words

    def tell(self, title: str, body: str, client: Any) -> None:
        """Show a message to one person, or to all where none is given."""
        clients = [client] if client is not None else self._server.get_clients().values()
        for one in clients:
            one.add_notification(title, body, auto_close_seconds=12.0, color="orange")

    def _say_at_pointer(self, text: str) -> None:
        self.controls.pointed.content = text

    def _show_command(self) -> None:
        out = self.controls.out.value
        settings = self.settings()
        own_file = Path(f"{out}.settings.yaml")
        if needs_file(settings, self._base):
            save_settings(settings, own_file)
        command = plan_command(
            str(self._source),
            out,
            settings.part.brr,
            settings,
            self._base,
            self._settings_file,
            own_file,
        )
        self.controls.command.content = f"The same on the command line:\n```\n{command}\n```"


def _set(handle: Any, name: str, value: Any) -> None:
    """Set a property, and send nothing where it is so already."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)


def _settings_of(result: ResultFolder, base: Settings) -> Settings:
    """What a result was planned with, as far as its summary tells."""
    summary = result.summary
    changes: dict[str, dict[str, Any]] = {"part": {"brr": result.part.brr}}
    for key, (section, name) in {
        "layer_thickness_mm": ("layers", "thickness_mm"),
        "engine": ("layers", "engine"),
        "bead_width_mm": ("toolpaths", "width_mm"),
    }.items():
        if key in summary:
            changes.setdefault(section, {})[name] = summary[key]
    return base.updated(changes)
