# SPDX-License-Identifier: Apache-2.0
"""Real nodes in processes of their own, and a client of them, over the real middleware."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

# A domain of its own for each test session, on this machine only.
os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "driver")]

from ros_processes import Process  # noqa: E402 - beside this file


@pytest.fixture(scope="session")
def ros() -> Iterator[None]:
    import rclpy

    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture(scope="session")
def session(ros: None) -> Iterator[Any]:
    """A client of both nodes."""
    from vega_planner.nodes.session import Session

    client = Session(name="test_client")
    yield client
    client.close()


@pytest.fixture(scope="session")
def planner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Process]:
    process = Process("vega_planner.nodes.planner", tmp_path_factory.mktemp("planner"))
    yield process
    process.end()


@pytest.fixture(scope="session")
def driver(tmp_path_factory: pytest.TempPathFactory, session: Any) -> Iterator[Process]:
    """An active driver."""
    folder = tmp_path_factory.mktemp("driver")
    process = Process(
        "vega_robot_driver.nodes.robot_driver",
        folder,
        state_folder=str(folder / "machine"),
        time_scale=10.0,
    )
    session.bring_up()
    yield process
    process.end()


@pytest.fixture
def other(ros: None) -> Iterator[Any]:
    """A client in a namespace of its own, for drivers that come and go."""
    from vega_planner.nodes.session import Session

    client = Session(namespace="/other", name="test_client")
    yield client
    client.close()


@pytest.fixture
def start_driver(tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """Start drivers in the other namespace that keep their state in the test's folder."""
    started: list[Process] = []

    def start(**parameters: Any) -> Process:
        values = {"state_folder": str(tmp_path / "machine"), "time_scale": 10.0, **parameters}
        module = "vega_robot_driver.nodes.robot_driver"
        started.append(Process(module, tmp_path, namespace="/other", **values))
        return started[-1]

    yield start
    for process in started:
        process.end()
