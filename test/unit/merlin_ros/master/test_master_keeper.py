"""A master that answers once and hangs again while a node registers is still lost."""

from typing import Any, Iterator, List

import pytest

from merlin_ros.master import master_keeper, master_link
from merlin_ros.master.foreign_nodes import ForeignNodes
from merlin_ros.master.master_keeper import MasterKeeper
from merlin_ros.master.master_link import MasterSilent
from merlin_ros.master.master_watch import PATIENCE, WatchDecision

ME = "http://me:1"


@pytest.fixture
def keeper(monkeypatch: pytest.MonkeyPatch) -> Iterator[MasterKeeper]:
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    for name in ("logerr", "logwarn"):
        monkeypatch.setattr(master_keeper.rospy, name, lambda text: None)
    yield MasterKeeper("/node", ME)
    master_link.lost.clear()


def test_other_nodes_are_looked_for_at_once(keeper: MasterKeeper, monkeypatch: pytest.MonkeyPatch) -> None:
    """A master may be lost before the first regular look, and then nothing else knows of them."""
    looks: List[Any] = []
    monkeypatch.setattr(ForeignNodes, "look", lambda self, master: looks.append(master))
    keeper.keep_foreign_nodes()
    assert len(looks) == 1


def test_a_master_that_is_silent_at_once_does_not_keep_a_node_from_its_start(
    keeper: MasterKeeper, monkeypatch: pytest.MonkeyPatch
) -> None:
    def look(*_: Any) -> None:
        raise MasterSilent("the master hangs")

    monkeypatch.setattr(ForeignNodes, "look", look)
    keeper.keep_foreign_nodes()
    assert keeper._foreign is not None


def test_a_master_that_does_not_let_a_node_register_stays_lost(
    keeper: MasterKeeper, monkeypatch: pytest.MonkeyPatch
) -> None:
    attempts: List[bool] = []

    def register(*_: Any) -> None:
        attempts.append(master_link.lost.is_set())
        if len(attempts) == 1:
            raise MasterSilent("the master hangs again")

    monkeypatch.setattr(master_keeper, "register_again", register)
    keeper._watch.answered(1, ME)
    assert [keeper._watch.failed() for _ in range(PATIENCE)][-1] is WatchDecision.LOST
    keeper._lose()
    keeper._register(keeper._watch.answered(1, ME))
    assert master_link.lost.is_set()
    keeper._register(keeper._watch.answered(1, ME))
    assert attempts == [False, False]  # its own calls are made
    assert not master_link.lost.is_set()
