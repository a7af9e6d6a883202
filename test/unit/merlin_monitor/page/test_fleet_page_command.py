# SPDX-License-Identifier: Apache-2.0
"""The command that serves the page of a fleet: its mistakes, who sees it, its end; and a hub that hangs."""

import socket
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any, Iterator, Tuple

import pytest
from fleet_page_command import Command
from served import TOKEN, ask

from merlin_fleet.commands.fleet_command import main
from merlin_fleet.fleet_client import FleetClient
from merlin_monitor.access.operators import write_operators
from merlin_test import LONG
from merlin_test.etcd_process import DIRECT, EtcdProcess

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def etcd() -> Iterator[EtcdProcess]:
    made = EtcdProcess()
    yield made
    made.close()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--port", "port"), "port is not a port: 0 to 65535"),
        (("--port", "70000"), "70000 is not a port: 0 to 65535"),
        (("--host", "203.0.113.1", "--open-look"), "cannot listen on 203.0.113.1"),
        (("--page-key", "/nowhere.key"), "a key is given, but no certificate"),
        (("--page-key", "/nowhere.key", "--page-certificate", "/nowhere.pem"), "/nowhere.pem cannot be read"),
    ],
)
def test_mistakes_are_one_clear_line(
    etcd: EtcdProcess, capsys: pytest.CaptureFixture, arguments: Tuple[str, ...], words: str
) -> None:
    try:
        code: Any = main(["page", "--hub", etcd.endpoint, "--operators", "none", *arguments])
    except SystemExit as end:  # argparse's own
        code = end.code
    assert code == 2
    said = capsys.readouterr()
    assert words in said.err.splitlines()[-1]
    assert not said.out


@pytest.mark.parametrize(
    ("options", "status"), [((), 403), (("--open-look",), 200)], ids=["sign in", "open look"]
)
def test_other_computers_see_it_after_a_sign_in(
    etcd: EtcdProcess, tmp_path: Path, options: Tuple[str, ...], status: int
) -> None:
    operators = tmp_path / "operators.yaml"
    write_operators(operators, {"Ana": TOKEN})
    command = Command(
        etcd.endpoint, "--host", "0.0.0.0", "--port", "0", "--operators", str(operators), *options
    )
    here = f"http://127.0.0.1:{command.address.rstrip('/').rpartition(':')[2]}/"
    answer = ask(here, "state.json")
    assert (answer.status, '"fleet"' in answer.said) == (status, status == 200)
    assert ask(here).status == 200, "the page itself is no secret"
    assert command.end()[0] == 0


def test_a_page_that_no_visitor_could_look_at_is_not_served(
    etcd: EtcdProcess, capsys: pytest.CaptureFixture
) -> None:
    assert main(["page", "--hub", etcd.endpoint, "--operators", "none", "--host", "0.0.0.0"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("fleet page: nobody could look at the page: --host 0.0.0.0 opens it")
    assert "give --operators FILE, or --open-look to show" in line


def test_operators_whom_all_can_read_are_refused(
    etcd: EtcdProcess, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    file = tmp_path / "operators.yaml"
    file.write_text("ana: 'a text that is long'\n")
    file.chmod(0o644)
    assert main(["page", "--hub", etcd.endpoint, "--operators", str(file)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("fleet page: the operators' file") and "chmod 600" in line


def test_it_serves_without_a_master_until_ctrl_c(etcd: EtcdProcess) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        command = Command(etcd.endpoint, "--operators", "none", "--port", str(port))
        assert command.address.startswith("http://127.0.0.1:")
        with DIRECT.open(command.address + "state.json", timeout=LONG) as answer:
            assert b'"fleet":"lab"' in answer.read()
        request = urllib.request.Request(command.address + "control/send", b"{}", method="POST")
        with pytest.raises(urllib.error.HTTPError, match="403"):
            DIRECT.open(request, timeout=LONG)
        code, said = command.end()
    assert code == 0
    assert f"port {port} is taken, using " in said


def test_a_hub_that_hangs_is_noticed() -> None:
    own = EtcdProcess()
    client = FleetClient("lab", [own.endpoint])
    try:
        assert client.wait_for_hub(LONG)
        own.hang()
        assert client.wait(lambda: client.missing == "etcd does not answer in time", LONG), client.missing
        own.resume()
        assert client.wait_for_hub(LONG)
    finally:
        client.close()
        own.close()
