# SPDX-License-Identifier: Apache-2.0
"""Where the pointer rests on the picture.

viser tells of clicks only. A script of a few lines waits until the pointer has rested and
types its place into a text field that nobody sees; viser brings what is typed here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vega_planner.datatypes import Floats
from vega_planner.viewer.picking import ray_through_pixel

#: Label by which the script finds the field.
_LABEL = "pointer at"
#: How long the pointer must rest [ms].
_REST_MS = 200
_SCRIPT = f"""
(function start() {{
  const label = [...document.querySelectorAll('label, div, span, p')].find(
    (item) => item.children.length === 0 && item.textContent.trim() === '{_LABEL}');
  let row = label;
  while (row && !row.querySelector('input')) row = row.parentElement;
  if (!row) {{ setTimeout(start, 200); return; }}
  row.style.display = 'none';
  const field = row.querySelector('input');
  const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
  let timer = 0;
  window.vegaPointer && window.removeEventListener('pointermove', window.vegaPointer, true);
  window.vegaPointer = (event) => {{
    clearTimeout(timer);
    const canvas = document.querySelector('canvas');
    if (event.buttons || !canvas || event.target.closest('input, button, p')) return;
    const box = canvas.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width;
    const y = (event.clientY - box.top) / box.height;
    if (x < 0 || x > 1 || y < 0 || y > 1) return;
    timer = setTimeout(() => {{
      set.call(field, x.toFixed(5) + ' ' + y.toFixed(5));
      field.dispatchEvent(new Event('input', {{ bubbles: true }}));
    }}, {_REST_MS});
  }};
  window.addEventListener('pointermove', window.vegaPointer, true);
}})()
"""
#: An empty picture, whose arrival starts the script.
_DOT = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7"


def watch_pointer(gui: Any, rested: Callable[[Floats, Floats, Any], None]) -> None:
    """Call back when a person's pointer rests on the picture.

    Args:
        gui: viser's GUI; to be called outside of tabs and folders.
        rested: Receives origin [m] and direction of the ray under the pointer, in the
            scene's frame, and the client.
    """
    field = gui.add_text(_LABEL, "")
    quoted = _SCRIPT.replace("&", "&amp;").replace('"', "&quot;").replace("\n", " ")
    gui.add_html(f'<img src="{_DOT}" width="1" height="1" onload="{quoted}">')

    @field.on_update
    def _(event: Any) -> None:
        if event.client is None:
            return
        try:
            x, y = (float(word) for word in field.value.split())
            camera = event.client.camera
            ray = ray_through_pixel(
                camera.position, camera.wxyz, camera.fov, camera.aspect, (x, y)
            )
        except (ValueError, AssertionError):  # typed by hand; or the camera is not known yet
            return
        rested(*ray, event.client)
