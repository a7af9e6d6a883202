# SPDX-License-Identifier: Apache-2.0
"""The client of a knowledge base asks for the domain once in the life of that knowledge base."""

from typing import Any, Dict, List, Optional

import pytest
import rospy
from diagnostic_msgs.msg import KeyValue
from rosplan_knowledge_msgs.msg import DomainFormula, KnowledgeItem
from rosplan_knowledge_msgs.srv import (
    GetDomainAttributeServiceResponse,
    GetInstanceServiceResponse,
    KnowledgeQueryServiceResponse,
    KnowledgeUpdateServiceArrayResponse,
)
from std_srvs.srv import TriggerResponse

from merlin_planning.knowledge_client import ADD, KnowledgeClient, KnowledgeError, Update, fact
from merlin_ros.service_proxy import ServiceUnavailable


class Server:
    """A knowledge base that is restarted with another domain."""

    def __init__(self) -> None:
        self.predicates = ["checked"]
        self.connected = True
        self.asked: List[str] = []
        self.refusal: Optional[str] = "unknown predicate 'chekced'"

    def proxy(self, name: str, *_: Any, **__: Any) -> "Proxy":
        return Proxy(self, name)


class Proxy:
    def __init__(self, server: Server, name: str) -> None:
        self.name = name
        self._server = server

    @property
    def connected(self) -> bool:
        return self._server.connected

    def __call__(self, *arguments: Any) -> Any:
        self._server.asked.append(self.name)
        if self.name == "/kb/query_state":  # it knows that hall is linked to kitchen
            asked = [{value.key: value.value for value in item.values} for item in arguments[0]]
            return KnowledgeQueryServiceResponse(
                results=[names == {"from": "hall", "to": "kitchen"} for names in asked]
            )
        answers: Dict[str, Any] = {
            "/kb/domain/predicates": GetDomainAttributeServiceResponse(
                [DomainFormula(name=name) for name in self._server.predicates]
            ),
            "/kb/update_array": KnowledgeUpdateServiceArrayResponse(False),
            "/kb/last_refusal": TriggerResponse(True, self._server.refusal or ""),
            "/kb/state/instances": GetInstanceServiceResponse(["kitchen"]),
        }
        if self.name == "/kb/last_refusal" and self._server.refusal is None:
            raise ServiceUnavailable("no such service")
        return answers[self.name]


@pytest.fixture
def server() -> Server:
    return Server()


@pytest.fixture
def client(server: Server, monkeypatch: pytest.MonkeyPatch) -> KnowledgeClient:
    monkeypatch.setattr(rospy, "resolve_name", lambda name: name)
    return KnowledgeClient("/kb", server.proxy)  # type: ignore[arg-type]


def test_a_refusal_says_why(client: KnowledgeClient, server: Server) -> None:
    for refusal, words in ((server.refusal, "unknown predicate 'chekced'"), (None, "its log says why")):
        server.refusal = refusal
        with pytest.raises(KnowledgeError, match=words):
            client.update([Update(ADD, fact("chekced", "kitchen"))])


def test_a_negative_fact_is_asked_with_the_keys_of_its_arguments(client: KnowledgeClient) -> None:
    values = [KeyValue("to", "kitchen"), KeyValue("from", "hall")]
    linked = [
        KnowledgeItem(
            knowledge_type=KnowledgeItem.FACT, attribute_name="linked", values=values, is_negative=negative
        )
        for negative in (False, True)
    ]
    assert client.query(linked) == [True, False]


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
