# SPDX-License-Identifier: Apache-2.0
"""The panel beside the picture: buttons, time, tabs. Holds handles and decides nothing."""

from __future__ import annotations

from typing import Any

from vega_planner.viewer.job import RUNNING
from vega_planner.viewer.legend import STYLE, legend
from vega_planner.viewer.path_view import COLOURINGS
from vega_planner.viewer.section import CUTS

#: What a click on the part or on a layer does.
PICK_REGION, PICK_FACE, EXPLAIN = "choose smooth region", "choose single face", "explain"
CLICKS = (PICK_REGION, PICK_FACE, EXPLAIN)
#: Which layers are shown.
ALL_LAYERS, UP_TO_NOW, THIS_LAYER, NO_LAYERS = "all", "up to now", "this one", "none"
LAYER_CHOICES = (UP_TO_NOW, THIS_LAYER, ALL_LAYERS, NO_LAYERS)
SPEEDS = ("x1", "x10", "x60", "x300")
#: What prints, and how much faster than the clock a simulated machine does.
HARDWARE, PACES = ("simulated", "emulated", "ethercat"), ("x1", "x10", "x60", "x500")


class Controls:
    """Handles of everything that can be pressed, moved or read."""

    def __init__(self, server: Any, out: str) -> None:
        """Build the panel.

        Args:
            server: viser's server.
            out: Result folder that is offered.
        """
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.add_html(STYLE)
        self.status = gui.add_markdown("starting")
        self.bar = gui.add_progress_bar(0.0)
        self.plan = gui.add_button("Plan", hint="Plan into the result folder.")
        self.print = gui.add_button("Print", color="green", hint="Print the plan that is shown.")
        self.pause = gui.add_button("Pause", hint="Stop on the path, dispenser off.")
        self.resume = gui.add_button("Resume", color="green", hint="Go on where it paused.")
        self.stop = gui.add_button("Stop", color="red", hint="End the job, dispenser off.")
        self.time = gui.add_slider(
            "time [s]", 0.0, 1.0, 0.1, 1.0, hint="Time of the print.", disabled=True
        )
        self.play = gui.add_checkbox("play", False, hint="Let the time run.", disabled=True)
        self.moment = gui.add_markdown("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Region"):
            self._build_region(gui)
        with tabs.add_tab("Show"):
            self._build_show(gui)
        with tabs.add_tab("Result"):
            self.result = gui.add_markdown("No plan yet.")
        self.settings_tab = tabs.add_tab("Settings")
        with self.settings_tab:
            self.out = gui.add_text("result folder", out, hint="Where Plan writes to.")
            self.hardware = gui.add_dropdown("machine", HARDWARE, initial_value=HARDWARE[0])
            self.machine_pace = gui.add_dropdown(
                "simulated at", PACES, initial_value=PACES[2], hint="Times the pace of the clock."
            )

    def add_icons(self) -> None:
        """Put icons on the buttons; reading them takes a moment, so it is done late."""
        for button, icon in (
            (self.plan, "route"),
            (self.print, "player-play"),
            (self.pause, "player-pause"),
            (self.resume, "player-play"),
            (self.stop, "player-stop"),
        ):
            button.icon = icon

    def show_buttons(self, state: str, *, planning: bool, can_plan: bool, can_print: bool) -> None:
        """Show the buttons that can be pressed now.

        Args:
            state: State of the machine, as in `JobState`.
            planning: Whether a plan is being made.
            can_plan: Whether one could be.
            can_print: Whether there is a plan to print.
        """
        for button, visible in (
            (self.plan, can_plan),
            (self.print, can_print),
            (self.pause, state == "printing"),
            (self.resume, state == "paused"),
            (self.stop, planning or state in RUNNING),
        ):
            put(button, "visible", visible)

    def _build_region(self, gui: Any) -> None:
        self.click = gui.add_dropdown("click", CLICKS, initial_value=PICK_REGION)
        self.pointed = gui.add_markdown("Click on the part.")
        self.specs = gui.add_text(
            "SPECs", "", hint="none, auto, down, normal:X,Y,Z[:DEG], point:X,Y,Z, faces:FILE, "
            "not:SPEC; several with blanks between.",
        )  # fmt: skip
        self.use_specs = gui.add_button("Use these SPECs", color="gray")
        self.clear = gui.add_button("Clear region", color="gray")
        self.preview = gui.add_checkbox(
            "show resulting layers", True, hint="Work the layers out after each click."
        )
        self.command = gui.add_markdown("")

    def _build_show(self, gui: Any) -> None:
        self.legend = gui.add_html(legend((), by_speed=False))
        self.show_part = gui.add_checkbox("part", True)
        self.show_region = gui.add_checkbox("restraint region", True)
        self.show_robot = gui.add_checkbox("robot", True)
        self.show_path = gui.add_checkbox("toolpath", True)
        self.layers = gui.add_dropdown("layers", LAYER_CHOICES, initial_value=UP_TO_NOW)
        self.cut = gui.add_dropdown("section", CUTS, initial_value=CUTS[0])
        self.colouring = gui.add_dropdown(
            "toolpath colour", COLOURINGS, initial_value=COLOURINGS[0]
        )
        self.play_speed = gui.add_dropdown("play speed", SPEEDS, initial_value=SPEEDS[1])
        self.detail = gui.add_checkbox(
            "full detail", False, hint="Every face and point; wants a graphics card."
        )


def put(handle: Any, name: str, value: Any) -> None:
    """Set a property, and send nothing where it is so already."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)
