# SPDX-License-Identifier: Apache-2.0
"""`vega view`: the web server of the viewer, on this machine only unless told otherwise."""

from __future__ import annotations

import contextlib
import io
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

from vega_planner.errors import InvalidInput
from vega_planner.viewer.job import JobPort, LocalJob
from vega_planner.viewer.origin import is_loopback, own_pages_only
from vega_planner.viewer.target import find_target


def serve(target: str, *, host: str = "127.0.0.1", port: int = 8080, browser: bool = True) -> None:
    """Show a result folder or a mesh in the browser until interrupted.

    Args:
        target: Result folder or mesh file.
        host: Address to listen on.
        port: Port to listen on; 0 takes a free one.
        browser: Open the person's browser.

    Raises:
        InvalidInput: If the target is neither, or the address or port cannot be used.
        VegaError: If the target cannot be read.
    """
    # Told to end, it ends as on Ctrl-C: nodes that it started must not outlive it.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with open_viewer(target, host=host, port=port) as (viewer, url):
        print(f"vega view: {url} (Ctrl-C ends)", flush=True)
        if browser:
            import webbrowser

            threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
        viewer.load()
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()


@contextlib.contextmanager
def open_viewer(
    target: str,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    make_job: Callable[[], JobPort] | None = None,
) -> Iterator[tuple[Any, str]]:
    """Start a viewer; it is stopped when the block ends.

    Args:
        target: Result folder or mesh file.
        host: Address to listen on.
        port: Port to listen on; 0 takes a free one.
        make_job: Makes what plans and prints, on first use; by default the ROS nodes.

    Yields:
        The viewer, whose `load` brings the picture, and the URL.

    Raises:
        InvalidInput: If the target is neither, or the address or port cannot be used.
    """
    found = find_target(target)
    check_port(host, port)
    import viser

    from vega_planner.viewer.app import Viewer

    silence = contextlib.redirect_stdout(io.StringIO())  # viser's banner
    with silence, own_pages_only(is_loopback(host)):
        server = viser.ViserServer(host=host, port=port, label="Vega", verbose=False)
    try:
        if port and server.get_port() != port:
            raise InvalidInput(f"port {port} of {host} is taken; name another one with --port N")
        _announce_people(server, host)
        viewer = Viewer(server, found, make_job or default_job)
        try:
            yield viewer, f"http://{_named(host)}:{server.get_port()}"
        finally:
            viewer.close()
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def check_port(host: str, port: int) -> None:
    """Try whether an address can be listened on.

    Raises:
        InvalidInput: If not, naming it and the reason.
    """
    try:
        places = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        family, kind, protocol, _, address = places[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            probe.listen(1)
    except socket.gaierror as error:
        raise InvalidInput(f"host '{host}' is not known: {error.strerror}") from error
    except PermissionError as error:
        raise InvalidInput(f"port {port} needs more rights; take one above 1023") from error
    except OSError as error:
        taken = "is taken; name another one with --port N"
        reason = taken if error.errno in (98, 48) else f"cannot be used: {error.strerror}"
        raise InvalidInput(f"port {port} of {host} {reason}") from error


def default_job() -> JobPort:
    """The ROS 2 nodes where ROS 2 is installed; else planning in this process."""
    try:
        from vega_planner.nodes.viewer_port import RosJob
    except ImportError:
        return LocalJob()
    return RosJob()


def _announce_people(server: Any, host: str) -> None:
    """Tell everyone when a second person connects: they share the buttons."""
    if not is_loopback(host):
        print(
            f"vega view: listening on {host}: whoever reaches this port can start and stop "
            "the robot",
            file=sys.stderr,
        )

    @server.on_client_connect
    def _(client: Any) -> None:
        people = len(server.get_clients())
        if people > 1:
            text = f"{people} viewers are connected now; all share this view and its buttons."
            print(f"vega view: {text}", file=sys.stderr, flush=True)
            for one in server.get_clients().values():
                one.add_notification("Someone else is here", text, auto_close_seconds=10.0)


def _named(host: str) -> str:
    if host in ("0.0.0.0", "::"):
        return "localhost"
    return f"[{host}]" if ":" in host else host
