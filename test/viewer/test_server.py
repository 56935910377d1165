# SPDX-License-Identifier: Apache-2.0
"""What `vega view` refuses, and whom it lets in."""

import socket

import pytest

from vega_planner.cli import main
from vega_planner.errors import InvalidInput
from vega_planner.viewer.origin import is_loopback, is_own_page
from vega_planner.viewer.server import check_port, open_viewer


def refusal(capsys, *words):
    assert main(["view", *words, "--no-browser"]) == 2
    shown = capsys.readouterr()
    assert shown.err.count("\n") == 1
    return shown.err


def test_a_taken_port_is_told_and_no_other_is_taken_instead(sample, capsys):
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        port = holder.getsockname()[1]
        told = refusal(capsys, str(sample), "--port", str(port))
        assert f"port {port}" in told
        assert "--port" in told


def test_a_target_that_is_not_there_is_told(capsys):
    assert "no/such.stl" in refusal(capsys, "no/such.stl")


def test_a_folder_without_a_result_is_told(tmp_path, capsys):
    assert "summary.json" in refusal(capsys, str(tmp_path))


def test_a_file_that_is_no_mesh_is_told(tmp_path, capsys):
    path = tmp_path / "words.stl"
    path.write_text("not a mesh")
    assert main(["view", str(path), "--port", "0", "--no-browser"]) == 2
    assert "words" in capsys.readouterr().err


def test_an_unknown_host_is_told():
    with pytest.raises(InvalidInput, match="no-such-host"):
        check_port("no-such-host.invalid", 8080)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.3.2.1", "::1", "localhost"])
def test_loopback_addresses_are_known(host):
    assert is_loopback(host)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5", "::", "printer.lan"])
def test_other_addresses_are_not_loopback(host):
    assert not is_loopback(host)


def test_it_listens_on_loopback_only_unless_told_otherwise(sample):
    """The machine's other address does not answer."""
    with open_viewer(str(sample), port=0) as (_, url):
        port = int(url.rsplit(":", 1)[1])
        with socket.create_connection(("127.0.0.1", port), timeout=5):
            pass
        with pytest.raises(OSError), socket.create_connection(("127.0.0.2", port), timeout=2):
            pass


@pytest.mark.parametrize(
    ("origin", "host", "loopback", "accepted"),
    [
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True, True),
        ("http://localhost:8080", "localhost:8080", True, True),
        (None, "127.0.0.1:8080", True, True),
        ("https://evil.example", "127.0.0.1:8080", True, False),
        ("http://127.0.0.1:9", "127.0.0.1:8080", True, False),
        ("http://evil.example:8080", "evil.example:8080", True, False),
        ("http://printer.lan:8080", "printer.lan:8080", False, True),
        ("https://evil.example", "printer.lan:8080", False, False),
    ],
)
def test_only_the_own_page_may_connect(origin, host, loopback, accepted):
    assert is_own_page(origin, host, loopback=loopback) is accepted


def test_a_foreign_page_is_refused_by_the_running_server(sample):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    with open_viewer(str(sample), port=0) as (_, url):
        address = url.replace("http", "ws")
        with connect(address, origin=url, subprotocols=["viser-v1.1.1"]):
            pass
        with pytest.raises(InvalidStatus, match="403"):
            connect(address, origin="https://evil.example", subprotocols=["viser-v1.1.1"])
