# SPDX-License-Identifier: Apache-2.0
"""`top` says why there is nothing to see."""

import socket
from typing import Any

import pytest

from merlin_monitor.terminal import top_node

pytestmark = pytest.mark.everywhere


def said(monkeypatch: Any, capsys: Any, uri: str) -> str:
    monkeypatch.setattr("sys.argv", ["top"])
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    assert top_node.main() == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("top: ") and uri in line
    return str(line)


@pytest.mark.parametrize("uri", ["nonsense", "http://localhost:99999", "http://a..b:11311"])
def test_a_wrong_address_is_one_line(uri: str, monkeypatch: Any, capsys: Any) -> None:
    assert "it has to be like http://localhost:11311" in said(monkeypatch, capsys, uri)


def test_a_master_that_hangs_is_not_one_that_is_not_there(monkeypatch: Any, capsys: Any) -> None:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        uri = f"http://127.0.0.1:{listener.getsockname()[1]}"
        assert "Connection refused" in said(monkeypatch, capsys, uri)
        listener.listen()
        assert "did not answer within" in said(monkeypatch, capsys, uri)
