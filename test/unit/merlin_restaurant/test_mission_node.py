"""How the mission's node ends: with the exit codes of its README, and a sentence instead of a traceback."""

from pathlib import Path
from typing import Any, Dict, List

import pytest

from merlin_restaurant import evening_results, mission_node
from merlin_restaurant.evening_record import CLOSED, EveningRecord
from merlin_restaurant.mission_node import BALANCED, EveningNode
from merlin_ros.service_proxy import ServiceError

GONE = "service /rosplan_knowledge_base/state/propositions does not answer: it is gone"


class Knowledge:
    """A knowledge base that answers, does not, or sees the node go down."""

    def __init__(self) -> None:
        self.answers = True

    def wait(self, timeout: float) -> bool:
        return self.answers


class Robot:
    """An evening that ends at once."""

    reason = ""

    def __init__(self) -> None:
        self.knowledge = Knowledge()
        self.gone = False

    def run(self) -> str:
        return "succeeded"

    def objects(self, kind: str) -> List[str]:
        if self.gone:
            raise ServiceError(GONE)
        return []

    def facts(self, predicate: str) -> List[str]:
        return []


class Node:
    """The node as :func:`main` makes it, its parameters, and whether it is going down."""

    def __init__(self, folder: Path) -> None:
        self.parameters: Dict[str, Any] = {"~results": str(folder)}
        self.robot = Robot()
        self.record = EveningRecord()
        self.record.guest_event(100.0, CLOSED, "", "", (), "")
        self.down = False


@pytest.fixture()
def node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Node:
    made = Node(tmp_path / "results")

    def begin(self: EveningNode, results: Path, startup: float, on_lost: str) -> None:
        watch = type("Watch", (), {"deeds": []})
        lock = mission_node.threading.Lock()
        self.__dict__.update(_results=results, _startup=startup, _start=None, _record=made.record)
        self.__dict__.update(_record_lock=lock, _evening=made.robot, _watch=watch)

    monkeypatch.setattr(EveningNode, "__init__", begin)
    monkeypatch.setattr(mission_node, "init_node", lambda name: None)
    monkeypatch.setattr(mission_node, "missing_interfaces", lambda knowledge, timeout: [])
    monkeypatch.setattr(mission_node, "missing_servers", lambda names, timeout: [])
    monkeypatch.setattr(mission_node, "is_shutdown_requested", lambda: made.down)
    monkeypatch.setattr(mission_node.rospy, "get_time", lambda: 0.0)
    monkeypatch.setattr(
        mission_node.rospy, "get_param", lambda name, default: made.parameters.get(name, default)
    )
    return made


def test_records_that_balance_are_written(node: Node, capsys: pytest.CaptureFixture) -> None:
    assert mission_node.main() == 0
    assert BALANCED in capsys.readouterr().out
    results = Path(node.parameters["~results"])
    assert sorted(path.name for path in results.iterdir()) == ["guests.csv", "timeline.png"]


def test_records_that_do_not_balance_are_another_end(node: Node) -> None:
    node.record.closed = None
    assert mission_node.main() == 1


def test_a_wait_that_is_interrupted_is_no_missing_knowledge_base(
    node: Node, capsys: pytest.CaptureFixture
) -> None:
    node.robot.knowledge.answers, node.down = False, True
    assert mission_node.main() == 130
    assert capsys.readouterr().err == ""


def test_a_missing_knowledge_base_is_named(node: Node, capsys: pytest.CaptureFixture) -> None:
    node.robot.knowledge.answers = False
    assert mission_node.main() == 2
    assert "no knowledge base after 90 s" in capsys.readouterr().err


@pytest.mark.parametrize(("down", "code", "said"), [(False, 2, f"mission: {GONE}\n"), (True, 130, "")])
def test_a_knowledge_base_that_is_gone_at_the_end_is_a_sentence(
    node: Node, capsys: pytest.CaptureFixture, down: bool, code: int, said: str
) -> None:
    def run() -> str:
        node.down, node.robot.gone = down, True
        return "aborted"

    node.robot.run = run
    assert mission_node.main() == code
    assert capsys.readouterr().err == said


def test_a_knowledge_base_that_goes_while_the_robot_is_waited_for_is_a_sentence(
    node: Node, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(*_: object) -> List[str]:
        raise ServiceError(GONE)

    monkeypatch.setattr(mission_node, "missing_interfaces", gone)
    assert mission_node.main() == 2
    assert capsys.readouterr().err == f"mission: {GONE}\n"


def test_a_timeout_that_is_no_number_is_named(node: Node, capsys: pytest.CaptureFixture) -> None:
    node.parameters["~startup_timeout"] = "x"
    assert mission_node.main() == 2
    assert "parameter ~startup_timeout is 'x', not a number" in capsys.readouterr().err
    assert not Path(node.parameters["~results"]).exists()


def test_a_folder_that_cannot_be_made_and_a_full_disk_are_two_things(
    node: Node, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(evening_results, "write_guests", full)
    assert mission_node.main() == 2
    printed = capsys.readouterr()
    assert BALANCED in printed.out, "what is known is said first"
    assert "the results cannot be written: [Errno 28] No space left on device" in printed.err

    (Path(node.parameters["~results"]) / "file").touch()
    node.parameters["~results"] += "/file/below"
    assert mission_node.main() == 2
    assert "no folder for the results" in capsys.readouterr().err
