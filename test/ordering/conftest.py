# SPDX-License-Identifier: Apache-2.0
"""The parts with exactly known layers, shared with the printability tests."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def envelopes() -> ModuleType:
    path = Path(__file__).parents[1] / "printability" / "envelopes.py"
    spec = importlib.util.spec_from_file_location("envelopes", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
