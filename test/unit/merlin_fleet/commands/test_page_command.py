# SPDX-License-Identifier: Apache-2.0
"""The fleet's page says at its start whether it can be operated."""

from pathlib import Path
from typing import Iterator, List

import pytest

from merlin_fleet.commands.fleet_command import main
from merlin_monitor.access.operators import SHORTEST_TOKEN, write_operators
from merlin_test.etcd_process import EtcdProcess

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def hub() -> Iterator[str]:
    etcd = EtcdProcess()
    yield etcd.endpoint
    etcd.close()


@pytest.mark.parametrize(
    "named, options, reported",
    [(False, [], True), (True, [], False), (False, ["--operators", "none"], False)],
    ids=["no file", "an operator", "none wanted"],
)
def test_a_page_without_operators_says_so(
    hub: str,
    named: bool,
    options: List[str],
    reported: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setattr("merlin_fleet.commands.page_command.wait_for_end", lambda key: None)
    file = tmp_path / "merlin" / "operators.yaml"
    if named:
        write_operators(file, {"ana": "x" * SHORTEST_TOKEN})
    assert main(["page", "--hub", hub, "--port", "0", *options]) == 0
    assert ("names no operator" in capsys.readouterr().out) is reported
