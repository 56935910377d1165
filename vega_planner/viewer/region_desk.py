# SPDX-License-Identifier: Apache-2.0
"""Choosing the restraint region: clicks, SPECs, the layers they lead to, the command."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

from vega_planner.datatypes import Floats, LayerStack, Part
from vega_planner.errors import VegaError
from vega_planner.settings import Settings
from vega_planner.viewer import controls as panel
from vega_planner.viewer.command import needs_file, plan_command, save_settings
from vega_planner.viewer.picking import first_hit
from vega_planner.viewer.picture import Picture
from vega_planner.viewer.preview import Preview
from vega_planner.viewer.restraint_picks import RestraintPicks
from vega_planner.viewer.section import AT_Y
from vega_planner.viewer.settings_panel import SettingsPanel
from vega_planner.viewer.target import Target


class RegionDesk:
    """What is chosen of the part, and with which settings it is planned.

    Attributes:
        picks: The region as it was clicked together; None before there is a part.
    """

    def __init__(
        self,
        target: Target,
        controls: panel.Controls,
        picture: Picture,
        fields: SettingsPanel,
        lock: threading.RLock,
    ) -> None:
        """Prepare.

        Args:
            target: What is looked at.
            controls: The panel.
            picture: The scene.
            fields: The fields of the settings.
            lock: Guards the scene.
        """
        self.picks: RestraintPicks | None = None
        self._target = target
        self._controls = controls
        self._picture = picture
        self._fields = fields
        self._lock = lock
        self._preview = Preview(self._show_preview, self.say)

    def settings(self) -> Settings:
        """Everything the panel says, the restraint region included.

        Raises:
            InvalidInput: If a value is out of its range.
        """
        return self._fields.settings(self.picks.specs if self.picks else ("none",))

    def take_part(self, part: Part) -> str:
        """Show a part and start with its region.

        Returns:
            What a person should know, or nothing.
        """
        file = Path(f"{self._controls.out.value}.faces.txt").absolute()
        remark = ""
        try:
            picks = RestraintPicks(
                part, self._target.settings.part, file, part.brr, part.restrained
            )
        except VegaError as error:
            # The region is known face by face, but its SPECs name files that have gone.
            remark = str(error)
            picks = RestraintPicks(part, self._target.settings.part, file)
        with self._lock:
            self.picks = picks
            self._picture.show_part(self._chosen(part))
            self._show_words()
            self._picture.refresh()
        return remark

    def click(self, origin: Floats, direction: Floats) -> None:
        """Pick what a ray [mm, part frame] meets first, or take its pick away.

        Raises:
            VegaError: If the pick leaves nothing to envelop.
        """
        part, picks = self._picture.part, self.picks
        if part is None or picks is None:
            return
        hit = first_hit(origin, direction, part.vertices, part.faces)
        if hit is None:
            return
        single = self._controls.click.value == panel.PICK_FACE
        with self._lock:
            self.say((picks.toggle_face if single else picks.toggle_region)(hit))
        self.changed()

    def use_specs(self) -> None:
        """Take the region from the text field.

        Raises:
            BadRestraint: If a SPEC is no good.
        """
        self._set(tuple(self._controls.specs.value.split()))

    def clear(self) -> None:
        """Choose nothing."""
        self._set(())

    def changed(self) -> None:
        """Show the region, and work out the layers it leads to."""
        part = self._picture.part
        if part is None:
            return
        with self._lock:
            part = self._chosen(part)
            self._picture.show_region(part)
            self._picture.forget_plan()
            self._show_words()
        self._preview.cancel()
        if self._controls.preview.value:
            self.say("Working the layers out.")
            self._preview.request(part, self.settings())

    def settings_changed(self) -> None:
        """Say the command, and work the layers out anew unless a whole plan is shown.

        Raises:
            VegaError: If a value is no good, or the settings file cannot be written.
        """
        self.show_command()
        self.preview_again()

    def preview_again(self) -> None:
        """Work the layers out anew, unless a whole plan is shown."""
        self._preview.cancel()
        if self._picture.result is None:
            self.changed()

    def give_up_preview(self) -> None:
        """Stop working layers out."""
        self._preview.cancel()

    def say(self, text: str) -> None:
        """Say something beside the region."""
        self._controls.pointed.content = text

    def show_command(self) -> None:
        """Show the command that plans the same.

        Raises:
            VegaError: If a value is no good, or the settings file cannot be written.
        """
        out = self._controls.out.value
        settings = self.settings()
        own_file = Path(f"{out}.settings.yaml")
        if needs_file(settings, self._target.settings):
            save_settings(settings, own_file)
        command = plan_command(
            str(self._target.source),
            out,
            settings.part.brr,
            settings,
            self._target.settings,
            self._target.settings_file,
            own_file,
        )
        self._controls.command.content = f"The same on the command line:\n```\n{command}\n```"

    def _set(self, specs: tuple[str, ...]) -> None:
        if self.picks is not None:
            with self._lock:
                self.picks.set_specs(specs)
            self.changed()

    def _chosen(self, part: Part) -> Part:
        assert self.picks is not None
        return replace(part, restrained=self.picks.faces, brr=self.picks.specs)

    def _show_words(self) -> None:
        assert self.picks is not None
        self._controls.specs.value = " ".join(self.picks.specs)
        self.show_command()

    def _show_preview(self, stack: LayerStack) -> None:
        with self._lock:
            self._controls.cut.value = AT_Y
            self._picture.show_preview(stack.sheets)
        self.say(f"{len(stack.layers)} layers, {len(stack.cores)} core layers.")
