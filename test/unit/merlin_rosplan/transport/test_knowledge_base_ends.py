# SPDX-License-Identifier: Apache-2.0
"""A knowledge base that ends in order: what it can no longer keep it does not answer, as one that died."""

from pathlib import Path
from typing import Any

import pytest

from merlin_ros.ports.service_server import Unanswered
from merlin_ros.service_proxy import ServiceUnavailable
from merlin_rosplan.transport import direct_service
from merlin_rosplan.transport.direct_service import DirectServiceProxy, offer
from merlin_test import LONG

# Its end waits for a subscriber as long as the test may take.
KNOWLEDGE = f"""
import sys
from merlin_ros import prompt_sending
from merlin_rosplan.nodes.knowledge_base import KnowledgeBase
from merlin_rosplan.transport.component import run_components
prompt_sending.READ_LIMIT = {LONG}
sys.exit(run_components("kb", KnowledgeBase))
"""
CLIENT = """
import sys
from merlin_planning.knowledge_client import ADD, KnowledgeError, Update, instance, knowledge_client
from merlin_ros.node import run_node
from merlin_ros.service_proxy import ServiceError
def start():
    knowledge = knowledge_client("kb")
    def run():
        for name in ("hall", "kitchen"):
            try:
                knowledge.update([Update(ADD, instance("poi", name))])
                print("added", flush=True)
            except (KnowledgeError, ServiceError) as error:
                print("not added:", type(error).__name__, error, flush=True)
            sys.stdin.readline()
    return run
sys.exit(run_node("client", start))
"""


@pytest.mark.processes
def test_a_change_that_comes_while_a_knowledge_base_ends_is_one_of_a_knowledge_base_that_is_gone(
    master: Any, tmp_path: Path
) -> None:
    domain = tmp_path / "domain.pddl"
    domain.write_text("(define (domain d) (:requirements :typing) (:types poi) (:predicates (p ?x - poi)))")
    for name, value in (("domain_path", str(domain)), ("state_file", str(tmp_path / "kb.sqlite"))):
        master.api.setParam("/test", f"/kb/{name}", value)
    knowledge, client = master.node(KNOWLEDGE), master.node(CLIENT)
    client.expect("added")
    with master.subscribed("/kb", "/kb/changes") as peer:
        knowledge.send(2)
        assert peer.recv(1) == b""  # its store is closed, and its services are not
        client.say("")
        said = client.expect("added")
        assert "ServiceUnavailable" in said and "its node has ended" in said
    assert knowledge.ended() == 0
    client.say("")
    assert client.ended() == 0


def test_a_component_of_the_same_process_learns_that_there_is_no_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ended = direct_service.threading.Event()

    class Ends:
        resolved_name = "/kb/update"
        request_class = type("Request", (), {"__slots__": (), "_connection_header": None})

        @staticmethod
        def handler(request: Any) -> Any:
            raise Unanswered

    monkeypatch.setattr(direct_service, "args_kwds_to_message", lambda *_: Ends())
    offer(Ends(), ended)  # type: ignore[arg-type]
    with pytest.raises(ServiceUnavailable, match="it ends"):
        DirectServiceProxy("/kb/update", object)()
    ended.set()
