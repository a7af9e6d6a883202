"""The client of a knowledge base asks for the domain once in the life of that knowledge base."""

from typing import Any, Dict, List

import pytest
import rospy
from rosplan_knowledge_msgs.msg import DomainFormula
from rosplan_knowledge_msgs.srv import GetDomainAttributeServiceResponse, GetInstanceServiceResponse

from merlin_sm.knowledge_client import KnowledgeClient


class Server:
    """A knowledge base that is restarted with another domain."""

    def __init__(self) -> None:
        self.predicates = ["checked"]
        self.connected = True
        self.asked: List[str] = []

    def proxy(self, name: str, *_: Any, **__: Any) -> "Proxy":
        return Proxy(self, name)


class Proxy:
    def __init__(self, server: Server, name: str) -> None:
        self.name = name
        self._server = server

    @property
    def connected(self) -> bool:
        return self._server.connected

    def __call__(self, *_: Any) -> Any:
        self._server.asked.append(self.name)
        answers: Dict[str, Any] = {
            "/kb/domain/predicates": GetDomainAttributeServiceResponse(
                [DomainFormula(name=name) for name in self._server.predicates]
            ),
            "/kb/state/instances": GetInstanceServiceResponse(["kitchen"]),
        }
        return answers[self.name]


@pytest.fixture
def server() -> Server:
    return Server()


@pytest.fixture
def client(server: Server, monkeypatch: pytest.MonkeyPatch) -> KnowledgeClient:
    monkeypatch.setattr(rospy, "resolve_name", lambda name: name)
    return KnowledgeClient("/kb", server.proxy)  # type: ignore[arg-type]


def test_the_domain_is_asked_for_once(client: KnowledgeClient, server: Server) -> None:
    assert list(client.predicates()) == list(client.predicates()) == ["checked"]
    assert server.asked == ["/kb/domain/predicates"]


def test_a_knowledge_base_that_was_restarted_is_asked_again(client: KnowledgeClient, server: Server) -> None:
    client.predicates()
    server.connected, server.predicates = False, ["delivered"]
    assert list(client.predicates()) == ["delivered"]


def test_its_objects_are_asked_for_each_time(client: KnowledgeClient, server: Server) -> None:
    assert client.instances() == client.instances() == ["kitchen"]
    assert server.asked == ["/kb/state/instances"] * 2
