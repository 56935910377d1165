# SPDX-License-Identifier: Apache-2.0
"""The EtherCAT driver against emulated drives: real frames, real faults."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

sys.path.insert(0, str(Path(__file__).parent))
from synthetic import machine, zigzag_job
from test_process import send, until

from vega_planner.errors import DriverError, Faulted, InvalidInput, Refused
from vega_robot_driver.link import MachineLink
from vega_robot_driver.motion.bus_config import read_bus_config
from vega_robot_driver.motion.cia402 import STATUS_BITS, TOWARDS_ENABLED, State, state_of
from vega_robot_driver.status import StatusPage

BUS = Path(__file__).parents[2] / "config" / "machines" / "emulated.yaml"


@pytest.fixture
def start(tmp_path: Path):
    links = []

    def begin(**changes: Any) -> MachineLink:
        values = {"hardware": "emulated", "time_scale": 20.0, "stale_s": 5.0, **changes}
        links.append(MachineLink(tmp_path, machine(**values)))
        return links[-1]

    yield begin
    for link in links:
        link.close()


def drives(folder: Path) -> dict[str, Any]:
    """What the drives do, as they tell themselves."""
    return json.loads((folder / "drives.json").read_text())


def printing(link: MachineLink, seconds: float = 20.0) -> None:
    """Start a print and wait until it dispenses."""
    link.ask("enable")
    send(link, zigzag_job(3, seconds=seconds))
    link.ask("run")
    until(lambda: link.status().dispenser_on and link.status().rate == 1.0)
    until(lambda: any(drive["outputs"] for drive in drives(link.folder)["drives"]))


def at_rest_and_off(folder: Path) -> Callable[[], bool]:
    def check() -> bool:
        told = drives(folder)["drives"]
        return all(not d["outputs"] and abs(d["speed"]) < 1000 for d in told)

    return check


def test_prints_to_the_end_over_the_line(start, tmp_path):
    link = start()
    link.ask("enable")
    send(link, zigzag_job(2))
    link.ask("run")
    until(lambda: link.status().state == "done", 60)
    status = link.status()
    assert status.paths_done == 2
    assert status.wrong_counters == 0
    assert status.idle_on_cycles == 0
    wanted = zigzag_job(2).positions[-1]
    assert abs(status.positions - wanted).max() < 1e-5
    until(at_rest_and_off(tmp_path))


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("jam 0", "x_axis .* 0x8611"),
        ("torque_off 1", "y_axis .* 0xFF01"),
        ("drive_fault 2", "z_axis .* 0x7300"),
        ("unplug 2", "wrong working counters"),
        ("lose_frames 4", "wrong working counters"),
        ("wrong_counters 5", "wrong working counters"),
    ],
)
def test_a_fault_stops_all_axes_and_closes_the_valve(start, tmp_path, fault, reason):
    link = start(time_scale=5.0)
    printing(link)
    link.ask("inject", fault=fault)
    until(lambda: link.status().state == "fault")
    status = link.status()
    assert not status.dispenser_on
    assert re.search(reason, status.detail), status.detail
    until(at_rest_and_off(tmp_path))
    assert link.status().idle_on_cycles == 0
    with pytest.raises(Faulted):
        link.ask("enable")
    link.ask("inject", fault="none")


def test_two_wrong_counters_are_forgiven(start):
    link = start(time_scale=5.0)
    printing(link, seconds=4.0)
    link.ask("inject", fault="wrong_counters 2")
    until(lambda: link.status().wrong_counters == 2)
    until(lambda: link.status().state != "printing", 60)
    assert link.status().state == "done"


def test_a_fault_is_left_only_on_request(start):
    link = start(time_scale=5.0)
    printing(link)
    link.ask("inject", fault="drive_fault 0")
    until(lambda: link.status().state == "fault")
    link.ask("inject", fault="none")
    link.ask("reset_fault")
    link.ask("enable")
    assert link.status().state == "idle"
    assert {state for _, state, _ in link.ask("axes")["axes"]} == {"operation enabled"}


def test_a_frozen_master_trips_the_drives_watchdog(start, tmp_path):
    link = start(time_scale=1.0)
    printing(link)
    os.kill(link.status().pid, signal.SIGSTOP)
    try:
        until(at_rest_and_off(tmp_path), 5)
        assert {d["bus_state"] for d in drives(tmp_path)["drives"]} == {4}
    finally:
        os.kill(link.status().pid, signal.SIGCONT)
    until(lambda: link.status().state == "fault")


def test_a_killed_master_leaves_the_valve_closed(start, tmp_path):
    link = start(time_scale=1.0)
    printing(link)
    os.kill(link.status().pid, signal.SIGKILL)
    until(at_rest_and_off(tmp_path), 5)


def test_a_client_that_is_gone_stops_the_print_along_its_path(start, tmp_path):
    link = start(time_scale=1.0)
    printing(link)
    link.close(shut_down=False)
    page = StatusPage(tmp_path)
    until(lambda: page.read().state == "stopped", 2)
    until(at_rest_and_off(tmp_path), 2)
    assert not page.read().dispenser_on
    again = MachineLink(tmp_path, None)
    again.close()


def changed_bus(folder: Path, change: Callable[[dict[str, Any]], None]) -> str:
    """The shipped machine file after a change."""
    content = yaml.safe_load(BUS.read_text())
    change(content)
    path = folder / "changed.yaml"
    path.write_text(yaml.safe_dump(content))
    return str(path)


def test_drives_are_known_by_their_alias_wherever_they_are_on_the_line(start, tmp_path):
    def by_alias(content: dict[str, Any]) -> None:
        content["axes"].reverse()  # so does the line
        for number, axis in enumerate(content["axes"]):
            del axis["serial"]
            axis["alias"] = 1000 + number

    link = start(config=changed_bus(tmp_path, by_alias))
    link.ask("enable")
    link.ask("move", positions=[0.01, 0, 0, 0, 0], speed_ratio=1.0)
    until(lambda: link.status().state == "done")
    until(lambda: abs(drives(tmp_path)["drives"][4]["position"] - 10_000) < 2)
    assert all(abs(drive["position"]) < 2 for drive in drives(tmp_path)["drives"][:4])


def test_drives_with_clocks_run_by_them_and_others_by_the_frames(start, tmp_path):
    def without(content: dict[str, Any]) -> None:
        content["bus"]["distributed_clocks"] = "off"

    assert start().ask("axes")["quality"]["clocks"] == "distributed"
    other = tmp_path / "other"
    other.mkdir()
    link = MachineLink(other, machine(hardware="emulated", config=changed_bus(tmp_path, without)))
    assert link.ask("axes")["quality"]["clocks"] == "frames"
    link.close()


def test_axes_are_homed_over_the_line_before_they_take_a_job(start, tmp_path):
    def homed(content: dict[str, Any]) -> None:
        content["axes"][1]["homing"] = {
            "method": 17,
            "speed": 200_000,
            "slow": 2_000,
            "acceleration": 1_000_000,
            "offset": -80_010,
        }

    link = start(config=changed_bus(tmp_path, homed))
    link.ask("enable")
    before = link.status().homing_epoch
    with pytest.raises(Refused, match="not homed"):
        send(link, zigzag_job(1))
    link.ask("home")
    until(lambda: link.status().state == "idle")
    assert link.status().homing_epoch == before + 1
    send(link, zigzag_job(1))
    assert json.loads((tmp_path / "homing.json").read_text())["epoch"] == before + 1


def test_a_client_that_waits_does_not_hide_that_another_died(start, tmp_path):
    """The next client is connected in the moment in which the first one dies."""
    link = start(time_scale=1.0)
    printing(link)
    waiting = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    waiting.connect(link._socket.getpeername())
    link.close(shut_down=False)
    page = StatusPage(tmp_path)
    until(lambda: page.read().state == "stopped", 5)
    assert "gone" in page.read().detail
    waiting.close()
    MachineLink(tmp_path, None).close()


def test_emulated_drives_wait_for_a_master_that_is_late(start, tmp_path):
    link = start(time_scale=1.0)
    printing(link)
    os.kill(link.status().pid, signal.SIGSTOP)
    time.sleep(0.4)  # twice their watchdog's time
    os.kill(link.status().pid, signal.SIGCONT)
    before = link.status().cycles
    until(lambda: link.status().cycles > before + 100)
    assert link.status().state == "printing", link.status().detail
    # The frame that was on its way when the master stopped may have come back too late.
    assert link.status().wrong_counters <= 1


def test_a_bus_without_its_interface_says_so(start):
    with pytest.raises(DriverError, match="interface 'nothing0' cannot be opened"):
        start(hardware="ethercat", config=str(BUS), interface="nothing0")


@pytest.mark.parametrize("key", ["serial", "scale", "offset", "vendor", "following_error"])
def test_nothing_of_an_axis_is_guessed(tmp_path, key):
    bus = yaml.safe_load(BUS.read_text())
    del bus["axes"][3][key]
    path = tmp_path / "bus.yaml"
    path.write_text(yaml.safe_dump(bus))
    with pytest.raises(InvalidInput, match=rf"axis a_axis lacks '{key}' \(from "):
        read_bus_config(path)


def test_a_misspelt_key_of_an_axis_or_of_the_bus_is_named(tmp_path):
    for place, key in ((("axes", 0), "serail"), (("bus",), "watchdog")):
        bus = yaml.safe_load(BUS.read_text())
        row = bus[place[0]] if len(place) == 1 else bus[place[0]][place[1]]
        row[key] = 1
        (tmp_path / "bus.yaml").write_text(yaml.safe_dump(bus))
        with pytest.raises(InvalidInput, match=f"has no '{key}'; choices: "):
            read_bus_config(tmp_path / "bus.yaml")


def test_two_drives_cannot_be_known_by_the_same_number(tmp_path):
    bus = yaml.safe_load(BUS.read_text())
    bus["axes"][1]["serial"] = bus["axes"][0]["serial"]
    (tmp_path / "bus.yaml").write_text(yaml.safe_dump(bus))
    with pytest.raises(InvalidInput, match="two axes have serial 101"):
        read_bus_config(tmp_path / "bus.yaml")


def test_ethercat_without_a_machine_file_says_what_is_missing():
    with pytest.raises(InvalidInput, match="needs a machine file"):
        read_bus_config("")


def test_status_words_tell_their_states():
    for state, bits in STATUS_BITS.items():
        free = 0x20 if bits & 0x27 in (0x00, 0x08, 0x0F) or bits == 0x40 else 0
        assert state_of(bits) is state
        assert state_of(bits | 0x1210 | free) is state


def test_no_control_word_on_the_way_up_resets_a_fault():
    assert all(not word & 0x80 for word in TOWARDS_ENABLED.values())
    assert TOWARDS_ENABLED[State.FAULT] == 0
