# SPDX-License-Identifier: Apache-2.0
"""States for ROS keep why their last run went wrong."""

import socket
import threading
from typing import Callable, Tuple

import pytest
import rospy
from std_srvs.srv import Empty

import smach
from merlin_test import LONG
from smach_ros import ServiceState


class Master:
    """Knows where the service is, or does not answer."""

    def __init__(self, find: Callable[[], Tuple[int, str, str]]) -> None:
        self.find = find

    def lookupService(self, name: str) -> Tuple[int, str, str]:
        return self.find()


def gone() -> Tuple[int, str, str]:
    raise OSError("no master")


def test_a_service_that_is_not_offered_is_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "get_master", lambda: Master(gone))
    state = ServiceState("blade", Empty, server_wait_timeout=0.0)
    assert state.reason == ""
    assert state.execute(smach.UserData()) == "aborted"
    assert state.reason == "Service blade: not offered within 0.0 s (server_wait_timeout)"


@pytest.mark.parametrize("preempted", [False, True])
def test_a_master_that_hangs_holds_neither_a_preempt_nor_the_time_limit(
    preempted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, answers = threading.Event(), threading.Event()

    def hang() -> Tuple[int, str, str]:
        asked.set()
        assert answers.wait(LONG)
        return gone()

    monkeypatch.setattr(rospy, "get_master", lambda: Master(hang))
    state = ServiceState("blade", Empty, server_wait_timeout=None if preempted else 0.0)
    ends = []
    thread = threading.Thread(target=lambda: ends.append(state.execute(smach.UserData())), daemon=True)
    thread.start()
    assert asked.wait(LONG)
    if preempted:
        state.request_preempt()
    thread.join(LONG / 2)
    answers.set()
    assert ends == ["preempted" if preempted else "aborted"]


def test_the_error_of_a_callback_is_the_reason_of_that_run_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(userdata: smach.UserData, request: object) -> None:
        raise ValueError("no such stem")

    def preempt() -> Tuple[int, str, str]:
        state.request_preempt()
        return gone()

    state = ServiceState("blade", Empty, request_cb=refuse)
    with socket.create_server(("127.0.0.1", 0)) as server:
        uri = f"rosrpc://127.0.0.1:{server.getsockname()[1]}"
        monkeypatch.setattr(rospy, "get_master", lambda: Master(lambda: (1, "", uri)))
        assert state.execute(smach.UserData()) == "aborted"
    assert state.reason == "Service blade: no request could be made: ValueError: no such stem"
    monkeypatch.setattr(rospy, "get_master", lambda: Master(preempt))
    assert state.execute(smach.UserData()) == "preempted"
    assert state.reason == ""
