# SPDX-License-Identifier: Apache-2.0
"""Latency of cancels and interruptions through the whole robot, simulated at real-time factor 1."""

from pathlib import Path
from typing import Any, Dict

from executive.cancel_cycles import cancel_cycles

CYCLES = 220


def measure() -> Dict[str, Any]:
    return cancel_cycles(Path(__file__).with_name("apartment.launch"), CYCLES, longest=3.0)
