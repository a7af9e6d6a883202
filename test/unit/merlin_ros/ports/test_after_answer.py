# SPDX-License-Identifier: Apache-2.0
"""What a service does behind its answer."""

from typing import Any, List

import pytest

from merlin_ros.ports.service_server import Service, after_answer


class Answering(Service):
    """A service whose connection is a list of what happened."""

    def __init__(self, handler: Any, order: List[str]) -> None:
        self.handler, self.order = handler, order
        self.resolved_name = "/service"

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

    service = Answering(handler, order)
    service._answer(None, "first")
    service._answer(None, "second")
    assert order == ["serves first", "answer", "behind first", "serves second", "answer", "behind second"]


def test_it_is_called_at_once_where_no_request_is_served(order: List[str]) -> None:
    after_answer(lambda: order.append("at once"))
    assert order == ["at once"]


def test_it_is_called_when_the_answer_cannot_be_sent(order: List[str]) -> None:
    def handler(_: str) -> None:
        after_answer(lambda: order.append("behind"))
        raise OSError("the caller has gone")

    with pytest.raises(OSError):
        Answering(handler, order)._answer(None, "request")
    assert order == ["behind"]
    after_answer(lambda: order.append("at once"))
    assert order == ["behind", "at once"]
