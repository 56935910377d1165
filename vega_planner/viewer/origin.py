# SPDX-License-Identifier: Apache-2.0
"""Only the viewer's own page may talk to the viewer.

A browser lets any page of the web open a connection to this machine's own address; without
a check such a page could press Print. So a connection is accepted only where the page comes
from the address it talks to, and, on loopback, where that address is a name of loopback
(a foreign name that resolves to 127.0.0.1 is not).
"""

from __future__ import annotations

import http
import ipaddress
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit


def is_loopback(host: str) -> bool:
    """Whether an address is only reached from this machine."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_own_page(origin: str | None, host: str, *, loopback: bool) -> bool:
    """Tell whether a connection comes from the page this server serves.

    Args:
        origin: The request's Origin; None from programs that are no browser.
        host: The request's Host, with the port.
        loopback: Whether the server listens on loopback only.
    """
    if loopback and not is_loopback(urlsplit(f"//{host}").hostname or ""):
        return False
    return origin is None or urlsplit(origin).netloc == host


@contextmanager
def own_pages_only(loopback: bool) -> Iterator[None]:
    """Make a server that is started inside the block refuse other pages.

    viser hands no such option on to websockets, so that its call is completed here.
    """
    import websockets.asyncio.server as module

    original: Any = module.serve

    def serve(*words: Any, process_request: Callable[..., Any] | None = None, **named: Any) -> Any:
        def check(connection: Any, request: Any) -> Any:
            headers = request.headers
            if not is_own_page(headers.get("Origin"), headers.get("Host", ""), loopback=loopback):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "not from this page\n")
            return process_request(connection, request) if process_request else None

        return original(*words, process_request=check, **named)

    module.serve = serve  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        module.serve = original  # type: ignore[misc]
