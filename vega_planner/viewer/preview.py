# SPDX-License-Identifier: Apache-2.0
"""The layers that a restraint region leads to, worked out beside the clicking."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace

from vega_planner.datatypes import LayerStack, Part
from vega_planner.errors import Cancelled, VegaError
from vega_planner.progress import Progress
from vega_planner.settings import Settings

#: Longer than this [s] nobody waits for a preview.
PATIENCE_S = 10.0


class Preview:
    """Works out the layers of the latest region; an older one is given up."""

    def __init__(self, show: Callable[[LayerStack], None], say: Callable[[str], None]) -> None:
        """Prepare.

        Args:
            show: Receives the layers.
            say: Receives what a person should know instead.
        """
        self._show, self._say = show, say
        self._latest = 0
        self._lock = threading.Lock()

    def request(self, part: Part, settings: Settings) -> None:
        """Start on a region, in a thread of its own."""
        with self._lock:
            self._latest += 1
            ticket = self._latest
        threading.Thread(
            target=self._work, args=(ticket, part, settings), daemon=True, name="preview"
        ).start()

    def cancel(self) -> None:
        """Give up what is running."""
        with self._lock:
            self._latest += 1

    def _work(self, ticket: int, part: Part, settings: Settings) -> None:
        from vega_planner.layers import generate_layers

        began = time.monotonic()

        def report(progress: Progress) -> None:
            if ticket != self._latest or time.monotonic() - began > PATIENCE_S:
                raise Cancelled("the preview was given up")

        try:
            stack = generate_layers(
                part, settings.layers, report, edge_angle_deg=settings.part.edge_angle_deg
            )
        except Cancelled:
            if ticket == self._latest:
                self._say(f"The layers take longer than {PATIENCE_S:g} s; press Plan for them.")
            return
        except VegaError as error:
            if ticket == self._latest:
                self._say(str(error))
            return
        if ticket == self._latest:
            self._show(replace(stack, part=part))
