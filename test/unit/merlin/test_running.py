# SPDX-License-Identifier: Apache-2.0
"""A command finds the system that it means, and says so when there is none or more than one."""

import os
import sys
from pathlib import Path

import pytest
import rosgraph
from rospy import core

from merlin import reload, running
from merlin.launch_request import LaunchError
from merlin_ros import node
from merlin_ros.master import master_link

pytestmark = pytest.mark.everywhere


class Graph:
    """Stands in for a master."""

    def __init__(self, *services: str) -> None:
        self.services = services

    def getSystemState(self, _: str) -> tuple:
        return 1, "", [[["/rosout", ["/talker"]]], [], [[name, ["/host"]] for name in self.services]]


class Gone:
    """Stands in for a master that has ended."""

    def getSystemState(self, _: str) -> tuple:
        raise ConnectionRefusedError(111, "Connection refused")


@pytest.fixture
def masters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict:
    there: dict = {}
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setenv("ROS_MASTER_URI", "http://env:1")
    monkeypatch.setattr(master_link, "bounded_proxy", lambda uri, timeout: there.get(uri, Gone()))
    return there


def run(uri: str):
    return running.announced(uri, Path("/there/my.launch"), Path("/log"))


def find(nodes: list, services: list) -> list:
    return reload.wanted(services, [])


def test_a_run_is_found_as_long_as_it_lives(masters: dict) -> None:
    masters["http://run:2"] = Graph("/merlin_fsm_host/reload_actions", "/other")
    with run("http://run:2"):
        assert [found.uri for found in running.living()] == ["http://run:2"]
        assert running.choose(find, "hosts") == ("http://run:2", ["/merlin_fsm_host/reload_actions"])
    assert running.living() == []
    with pytest.raises(LaunchError, match=r"no running system has hosts; asked: http://env:1"):
        running.choose(find, "hosts")


def test_the_master_of_the_environment_is_asked_too(masters: dict) -> None:
    masters["http://env:1"] = Graph("/merlin_fsm_host/reload_actions")
    masters["http://run:2"] = Graph("/other")
    with run("http://run:2"):
        assert running.choose(find, "hosts")[0] == "http://env:1"


def test_where_a_robot_has_no_executor_of_its_own_is_said(
    masters: dict, capsys: pytest.CaptureFixture
) -> None:
    masters["http://env:1"] = Graph("/merlin_fsm_host/reload_actions")
    assert running.at_robot("merlin send", "ria", lambda _: 0) == 2
    assert "no running system has an Executor in the namespace ria (robots of one plan share one" in (
        capsys.readouterr().err
    )


def test_of_two_runs_none_is_guessed_and_the_one_that_the_environment_names_is_meant(
    masters: dict, monkeypatch: pytest.MonkeyPatch
) -> None:
    masters["http://run:2"] = masters["http://run:3"] = Graph("/merlin_fsm_host/reload_actions")
    with run("http://run:2"):
        note = running.folder() / f"{os.getpid()}.json"
        (running.folder() / "other.json").write_text(note.read_text().replace("run:2", "run:3"))
        with pytest.raises(LaunchError, match=r"choose one: .*ROS_MASTER_URI=http://run:3 \(my.launch\)"):
            running.choose(find, "hosts")
        monkeypatch.setenv("ROS_MASTER_URI", "http://run:3")
        assert running.choose(find, "hosts")[0] == "http://run:3"
        masters["http://env:1"] = masters["http://run:2"]
        monkeypatch.setenv("ROS_MASTER_URI", "http://env:1")
        assert running.choose(find, "hosts")[0] == "http://env:1", "that of the environment need not be a run"


def test_the_usual_master_is_guessed_no_more_than_a_run(
    masters: dict, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_MASTER_URI")
    usual = rosgraph.get_master_uri()
    masters[usual] = masters["http://run:2"] = Graph("/merlin_fsm_host/reload_actions")
    with run("http://run:2"), pytest.raises(LaunchError, match=f"choose one: ROS_MASTER_URI={usual} "):
        running.choose(find, "hosts")
    assert running.choose(find, "hosts")[0] == usual


def test_a_master_with_two_names_is_one_system(masters: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:7")
    masters["http://127.0.0.1:7"] = masters["http://localhost:7/"] = Graph("/host/reload_actions")
    with run("http://localhost:7/"):
        assert running.choose(find, "hosts")[0] == "http://127.0.0.1:7"


def test_the_note_of_a_killed_run_is_removed(masters: dict) -> None:
    with run("http://run:2"):
        note = running.folder() / f"{os.getpid()}.json"
        note.write_text(note.read_text().replace('"began": "', '"began": "9'))
        assert running.living() == []
        assert not note.exists()


def test_a_master_that_cannot_be_asked_says_why(masters: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    class Hangs:
        def getSystemState(self, _: str) -> tuple:
            raise master_link.MasterSilent("it did not answer within 2.5 s")

    class Misnamed:
        def getSystemState(self, _: str) -> tuple:
            raise UnicodeError("label empty or too long")

    masters["http://hangs:1"], masters["http://a..b:1"] = Hangs(), Misnamed()
    like = "it has to be like http://localhost:11311"
    for uri, why in (
        ("http://gone:1", "Connection refused"),
        ("http://hangs:1", "it did not answer within 2.5 s"),
        ("nonsense", like),
        ("http://localhost:99999", like),
        ("http://a..b:1", like),
    ):
        monkeypatch.setenv("ROS_MASTER_URI", uri)
        with pytest.raises(running.NothingRuns) as refused:
            running.choose(find, "hosts")
        assert f"asked: {uri} (ROS_MASTER_URI: {why})" in str(refused.value)


def test_hosts_can_be_named() -> None:
    services = ["/a/merlin_fsm_host/reload_actions", "/b/merlin_fsm_host/reload_actions"]
    assert reload.wanted(services, ["b/merlin_fsm_host"]) == services[1:]


def test_nothing_is_reloaded_when_one_of_the_named_hosts_is_not_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    services = ["/a/reload_actions", "/other"]
    monkeypatch.setattr(reload, "beside", lambda command, find, what, do: do(find([], services)))
    monkeypatch.setattr(reload, "ServiceProxy", lambda *_: pytest.fail("it was reloaded"))
    monkeypatch.setattr(sys, "argv", ["reload", "a", "b"])
    with pytest.raises(LaunchError, match="not there, or without actions: b; nothing was reloaded"):
        reload.main()


def test_ctrl_c_before_the_node_of_a_command_has_begun_is_no_success(
    masters: dict, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    masters["http://env:1"] = Graph("/merlin_fsm_host/reload_actions")

    def interrupted(*_: object, **__: object) -> None:
        raise SystemExit(0)

    monkeypatch.setattr(node, "init_node", interrupted)
    with pytest.raises(SystemExit) as ended:
        running.beside("merlin reload", find, "hosts", lambda found: 0)
    assert ended.value.code == 130
    assert not capsys.readouterr().err


def test_what_fails_because_of_ctrl_c_is_no_mistake(
    masters: dict, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    masters["http://env:1"] = Graph("/merlin_fsm_host/reload_actions")
    monkeypatch.setattr(node, "init_node", lambda *_, **__: None)
    monkeypatch.setattr(node, "end_node", lambda reason: monkeypatch.setattr(core, "_in_shutdown", True))
    monkeypatch.setattr(core, "_in_shutdown", False)

    def refused(found: list) -> int:
        raise LaunchError("the Executor does not answer")

    assert running.beside("merlin send", find, "hosts", refused) == 2
    assert "does not answer" in capsys.readouterr().err

    monkeypatch.setattr(core, "_in_shutdown", False)

    def broken_off(found: list) -> int:
        monkeypatch.setattr(core, "_in_shutdown", True)
        raise LaunchError("the Executor does not answer")

    assert running.beside("merlin send", find, "hosts", broken_off) == 130
    assert not capsys.readouterr().err
