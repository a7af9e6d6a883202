# SPDX-License-Identifier: Apache-2.0
"""Who may look and stop is true or false: with anything else the monitor does not start."""

from typing import Any

import pytest

from merlin_test.node_path import node_path

pytestmark = pytest.mark.processes


@pytest.mark.parametrize("name", ["open_stop", "open_look"])
def test_a_text_opens_nothing(master: Any, name: str) -> None:
    master.api.setParam("/test", f"/page/{name}", "false")
    monitor = master.spawn(node_path("merlin_monitor", "monitor"), "__name:=page", "_port:=0")
    assert monitor.ended() == 2
    assert f"parameter ~{name} is 'false'; it has to be true or false" in monitor.output
