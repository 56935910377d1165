# SPDX-License-Identifier: Apache-2.0
"""The dispenser's serial protocol, by published vectors and against an emulated device."""

from __future__ import annotations

import pytest

from vega_planner.errors import LinkTimeout, Refused
from vega_robot_driver.dispenser.musashi import MusashiDispenser, frame, unframe
from vega_robot_driver.emulators.musashi_device import MusashiDevice


@pytest.fixture
def device():
    device = MusashiDevice()
    yield device
    device.close()


@pytest.fixture
def connect(device):
    opened = []

    def connected(**options) -> MusashiDispenser:
        opened.append(MusashiDispenser(device.port, timeout_s=0.4, **options))
        opened[-1].open()
        return opened[-1]

    yield connected
    for dispenser in opened:
        dispenser.close()


@pytest.mark.parametrize(
    ("body", "wire"),
    [
        (b"UL001D01", b"\x0208UL001D01C1\x03"),
        (b"DI  ", b"\x0204DI  CF\x03"),
        (b"PS  0500", b"\x0208PS  0500F0\x03"),
        (b"A0", b"\x0202A02D\x03"),
        (b"A2", b"\x0202A22B\x03"),
    ],
)
def test_frames_are_those_of_published_vectors(body, wire):
    assert frame(body) == wire
    assert unframe(wire) == body


def test_reads_the_pressure(connect):
    assert connect().read_pressure() == 130e3


def test_writes_only_when_enabled(connect, device):
    dispenser = connect()
    with pytest.raises(Refused, match=r"set to 130 kPa, the job wants 120 kPa"):
        dispenser.set_pressure(120e3)
    assert device.pressure == 1300
    assert all(command.startswith(b"UL") for command in device.commands)


def test_reads_back_what_it_wrote(connect, device):
    dispenser = connect(writes=True)
    dispenser.set_pressure(120e3)
    assert device.pressure == 1200
    assert device.commands[-1].startswith(b"UL")


def test_a_rejected_pressure_is_refused(connect, device):
    with pytest.raises(Refused, match="rejects"):
        connect(writes=True).set_pressure(500e3)
    assert device.pressure == 1300


def test_a_damaged_answer_is_asked_for_again(connect, device):
    dispenser = connect()
    device.misbehaviour = "garble"
    assert dispenser.read_pressure() == 130e3


def test_a_silent_dispenser_times_out(connect, device):
    dispenser = connect()
    device.misbehaviour = "silent"
    with pytest.raises(LinkTimeout, match="no answer"):
        dispenser.read_pressure()


def test_the_toggle_is_never_sent(connect, device):
    dispenser = connect(writes=True)
    dispenser.set_pressure(100e3)
    dispenser.follow([True, False], 0.002)
    assert not any(command.startswith(b"DI") for command in device.commands)
