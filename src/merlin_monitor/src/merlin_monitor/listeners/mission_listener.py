"""Follows the mission, the Executor and the velocity guard."""

import time
from typing import Any

import rospy
from merlin_msgs.msg import ExecuteActionResult, ExecutorStatus, GoalQueue, GuardStatus, MissionStatus

from merlin_monitor.state.monitor_model import MonitorModel


class MissionListener:
    """Keeps the sections of the present, the queue and the guard up to date.

    :param state: the model.
    :param executor: name of the Executor's action.
    """

    def __init__(self, state: MonitorModel, executor: str) -> None:
        now, put = state.now, state.inbox.put
        self.status = _subscribe("merlin/status", ExecutorStatus, lambda m: put(now.executor, m, _time(m)))
        """The subscriber of the Executor's status; its connection shows whether the Executor lives."""
        self._subscribers = [
            _subscribe("merlin/mission", MissionStatus, lambda m: put(now.mission, m, _time(m), _sent_by(m))),
            _subscribe("merlin/queue", GoalQueue, lambda m: put(now.queue, m)),
            _subscribe(f"{executor}/result", ExecuteActionResult, lambda m: put(now.result, m, _time(m))),
            _subscribe(
                "merlin/guard", GuardStatus, lambda m: put(state.guard.status, m, _time(m), time.monotonic())
            ),
        ]


def _subscribe(topic: str, message_class: type, receive: Any) -> rospy.Subscriber:
    return rospy.Subscriber(topic, message_class, receive, queue_size=100, tcp_nodelay=True)


def _sent_by(message: Any) -> str:
    return str(message._connection_header.get("callerid", ""))


def _time(message: Any) -> float:
    return float(message.header.stamp.to_sec() or rospy.get_time())
