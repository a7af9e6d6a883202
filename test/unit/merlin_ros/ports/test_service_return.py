# SPDX-License-Identifier: Apache-2.0
"""A service whose process died is called again until it is back, as long as its caller may wait."""

import threading
from typing import List

import pytest

from merlin_ros import service_proxy
from merlin_ros.service_proxy import ServiceError, ServiceUnavailable, when_back


class Gone:
    """A service that answers at the n-th call."""

    def __init__(self, answers_at: int) -> None:
        self.calls = 0
        self._answers_at = answers_at

    def call(self) -> str:
        self.calls += 1
        if self.calls < self._answers_at:
            raise ServiceUnavailable("gone")
        return "answer"


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service_proxy, "RETRY", 0.0)


def test_one_that_comes_back_is_called_again() -> None:
    gone, reported = Gone(answers_at=3), []  # type: ignore[var-annotated]
    assert when_back(gone.call, on_gone=lambda: reported.append(gone.calls)) == "answer"
    assert (gone.calls, reported) == (3, [1])


def test_one_that_stays_away_is_an_error_in_the_end() -> None:
    reported: List[int] = []
    gone = Gone(answers_at=10**9)
    with pytest.raises(ServiceUnavailable):
        when_back(gone.call, 0.0, lambda: reported.append(1))
    assert (gone.calls, reported) == (1, [])


def test_a_caller_that_gives_up_does_not_wait() -> None:
    given_up = threading.Event()
    gone = Gone(answers_at=10**9)
    with pytest.raises(ServiceUnavailable):
        when_back(gone.call, 3600.0, given_up.set, given_up)
    assert gone.calls == 1


def test_a_refusal_is_not_repeated() -> None:
    def refuse() -> None:
        raise ServiceError("no")

    with pytest.raises(ServiceError, match="no"):
        when_back(refuse)
