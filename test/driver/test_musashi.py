# SPDX-License-Identifier: Apache-2.0
"""The dispenser's serial protocol, by published vectors and against an emulated device."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest

from vega_planner.errors import LinkTimeout, Refused
from vega_robot_driver.dispenser.dialects import DIALECTS, Parameters
from vega_robot_driver.dispenser.musashi import MusashiDispenser
from vega_robot_driver.dispenser.musashi_line import MusashiLine, frame, unframe
from vega_robot_driver.emulators.musashi_device import MusashiDevice

ON, OFF = np.ones(1, bool), np.zeros(1, bool)


@pytest.fixture(params=sorted(DIALECTS))
def device(request):
    device = MusashiDevice(dialect=request.param)
    device.dialect = request.param
    yield device
    device.close()


@pytest.fixture
def shooter():
    device = MusashiDevice(dialect="ml_808gx")
    device.dialect = "ml_808gx"
    yield device
    device.close()


@pytest.fixture
def opened():
    opened = []

    def connected(device, **options) -> MusashiDispenser:
        given = {"timeout_s": 0.4, "watch_s": 0.0, "dialect": device.dialect, **options}
        opened.append(MusashiDispenser(device.port, **given))
        opened[-1].open()
        return opened[-1]

    yield connected
    for dispenser in opened:
        dispenser.close()


def until(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it never came to be"
        time.sleep(0.001)


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


@pytest.mark.parametrize(
    ("dialect", "answer", "told"),
    [
        ("super_sigma", b"DA01P0100T00100V0050M0NPROD_00001", Parameters(100, 100, 50)),
        ("ml_808gx", b"D0P1300T0200OD00000OF00010", Parameters(1300, 200)),
    ],
)
def test_each_family_has_its_own_answers(dialect, answer, told):
    assert DIALECTS[dialect].parsed(answer) == told
    with pytest.raises(LinkTimeout, match="unknown answer"):
        DIALECTS[dialect].parsed(b"DA05050")


def test_reads_the_pressure(opened, device):
    assert opened(device).read_pressure() == 130e3


def test_writes_only_when_enabled(opened, device):
    dispenser = opened(device)
    with pytest.raises(Refused, match=r"set to 130 kPa, the job wants 120 kPa"):
        dispenser.set_pressure(120e3)
    assert device.pressure == 1300
    assert all(command[:2] in (b"UL", b"GC") for command in device.commands)


def test_reads_back_what_it_wrote_and_leaves_the_rest(opened, device):
    dispenser = opened(device, writes=True)
    dispenser.set_pressure(120e3)
    assert (device.pressure, device.time_ms, device.vacuum) == (1200, 100, 12)
    assert device.commands[-1][:2] in (b"UL", b"GC")


def test_a_write_that_changes_something_else_is_refused(opened, device):
    dispenser = opened(device, writes=True)
    execute = device._execute

    def wrongly(body):
        answer = execute(body)
        device.time_ms = 77
        return answer

    device._execute = wrongly
    with pytest.raises(Refused, match=r"keeps .*time_ms=77"):
        dispenser.set_pressure(120e3)


def test_a_rejected_pressure_is_refused(opened, device):
    with pytest.raises(Refused, match="rejects"):
        opened(device, writes=True).set_pressure(500e3)
    assert device.pressure == 1300


@pytest.mark.parametrize("misbehaviour", ["garble", "lose_verdict"])
def test_a_reading_whose_answer_is_damaged_or_lost_is_asked_for_again(
    opened, device, misbehaviour
):
    dispenser = opened(device)
    device.misbehaviour = misbehaviour
    assert dispenser.read_pressure() == 130e3
    assert device.misbehaviour == ""
    assert dispenser.fault == ""


def test_an_answer_that_comes_too_late_does_not_spoil_the_next(opened, device):
    dispenser = opened(device, timeout_s=0.15)
    byte = device._byte
    slow = [0.2]

    def slowly(seconds=0.1):
        found = byte(seconds)
        if found == b"\x05" and slow:
            time.sleep(slow.pop())
        return found

    device._byte = slowly
    while slow:  # the first byte may have been asked for before
        assert dispenser.read_pressure() == 130e3


def test_a_silent_dispenser_times_out(opened, device):
    dispenser = opened(device)
    device.misbehaviour = "silent"
    with pytest.raises(LinkTimeout, match="no answer"):
        dispenser.read_pressure()


def test_a_line_that_dies_is_a_fault_and_one_that_lives_again_is_none_after_a_reset(
    opened, device
):
    dispenser = opened(device, timeout_s=0.1, watch_s=0.05)
    device.misbehaviour = "silent"
    until(lambda: dispenser.fault)
    assert "no answer to ENQ" in dispenser.fault
    device.misbehaviour = ""
    dispenser.reset_fault()
    asked = len(device.commands)
    until(lambda: len(device.commands) > asked + 2)
    assert dispenser.fault == ""


def test_a_pressure_that_somebody_changes_is_a_fault(opened, device):
    dispenser = opened(device, watch_s=0.02)
    device.pressure = 1250
    until(lambda: dispenser.fault)
    assert "went from 130 kPa to 125 kPa" in dispenser.fault


def test_what_a_wire_starts_is_never_started_over_the_line(opened, device):
    dispenser = opened(device, writes=True)
    dispenser.set_pressure(100e3)
    assert dispenser.follow(ON, 0.002) == 100e3
    assert dispenser.follow(OFF, 0.002) == 0.0
    assert device.starts == 0


def test_shots_over_the_line_are_timed_and_end_by_themselves(opened, shooter):
    dispenser = opened(shooter, writes=True, shot_s=0.05)
    assert shooter.timed and shooter.time_ms == 50
    dispenser.follow(ON, 0.002)
    until(lambda: shooter.starts >= 3)
    assert dispenser.fault == ""
    dispenser.follow(OFF, 0.002)
    until(lambda: not shooter.open)
    started = shooter.starts
    time.sleep(0.2)
    assert shooter.starts <= started + 1  # one may have been on its way
    assert not shooter.open


def test_a_start_whose_verdict_is_lost_is_a_fault_and_not_repeated(opened, shooter):
    dispenser = opened(shooter, writes=True, shot_s=0.05)
    shooter.misbehaviour = "lose_start"
    dispenser.follow(ON, 0.002)
    until(lambda: dispenser.fault)
    assert "a shot was not confirmed" in dispenser.fault
    time.sleep(0.2)  # the wish is still there
    assert shooter.starts == 1
    assert not shooter.open


def test_shots_need_writes_and_a_published_start(shooter):
    with pytest.raises(Refused, match="its start is not published"):
        MusashiDispenser(shooter.port, dialect="super_sigma", writes=True, shot_s=0.2)
    with pytest.raises(Refused, match="'writes' is off"):
        MusashiDispenser(shooter.port, dialect="ml_808gx", shot_s=0.2)


def test_an_unknown_family_is_refused_with_the_choices(shooter):
    with pytest.raises(Refused, match="has: super_sigma, ml_808gx"):
        MusashiDispenser(shooter.port, dialect="sigma")


def test_a_line_that_hangs_up_is_a_dead_line():
    """With its other end closed a terminal answers with errors of its own."""
    here, there = os.openpty()
    line = MusashiLine(os.ttyname(there), 38400, 0.05)
    os.close(here)
    with pytest.raises(LinkTimeout):
        line.read("RS", lambda answer: answer)
    line.close()
    os.close(there)
