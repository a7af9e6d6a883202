# SPDX-License-Identifier: Apache-2.0
"""What a service does behind its answer."""

from types import SimpleNamespace
from typing import Any, List

import pytest
from rospy.exceptions import TransportTerminated

from merlin_ros.ports.service_server import Service, after_answer


class Answering(Service):
    """A service whose connection has these requests, and is a list of what happened."""

    def __init__(self, handler: Any, order: List[str], *requests: str) -> None:
        self.handler, self.order, self.requests = handler, order, list(requests)
        self.resolved_name = "/service"
        self.handle(SimpleNamespace(socket=None, close=lambda: order.append("closed")), {"persistent": "1"})

    def _receive(self, transport: Any) -> List[str]:
        if not self.requests:
            raise TransportTerminated("the client has gone")
        return [self.requests.pop(0)]

    def _handle_request(self, transport: Any, request: Any) -> None:
        self.handler(request)
        self.order.append("answer")


@pytest.fixture
def order() -> List[str]:
    return []


def test_it_is_called_behind_the_answer_to_its_request_and_once(order: List[str]) -> None:
    def handler(request: str) -> None:
        after_answer(lambda: order.append(f"behind {request}"))
        order.append(f"serves {request}")

    Answering(handler, order, "first", "second")
    served = ["serves first", "answer", "behind first", "serves second", "answer", "behind second"]
    assert order == [*served, "closed"]


def test_it_is_called_at_once_where_no_request_is_served(order: List[str]) -> None:
    after_answer(lambda: order.append("at once"))
    assert order == ["at once"]


def test_it_is_called_when_the_answer_cannot_be_sent(order: List[str]) -> None:
    def handler(_: str) -> None:
        after_answer(lambda: order.append("behind"))
        raise TransportTerminated("the caller has gone")

    Answering(handler, order, "request")
    after_answer(lambda: order.append("at once"))
    assert order == ["behind", "closed", "at once"]
