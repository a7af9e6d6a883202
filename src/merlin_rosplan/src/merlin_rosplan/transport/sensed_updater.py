# SPDX-License-Identifier: Apache-2.0
"""Writes what was sensed into a knowledge base: at once, in batches, with retries."""

import threading
import time
from typing import Any, Dict, Sequence, Set

import rospy

from merlin_planning.knowledge_client import ADD, KnowledgeError, Update, fact, function_value
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.threads import start_thread
from merlin_rosplan.knowledge.sensed_facts import Fact, SensedFacts, Value

RETRY = 1.0  # s of wall time after the knowledge base did not take something
LONGEST_RETRY = 32.0  # s; what it refuses again and again, a fact of an object that is gone, may wait
LOG_PERIOD = 5.0  # s between two log lines with the same reason
#: What a knowledge base does not take, and what users' sensors find that no message can carry.
REFUSED = (KnowledgeError, ValueError, TypeError, OverflowError)


class SensedUpdater:
    """Keeps what was sensed and sends what is new to the knowledge base, in a thread of its own.

    :param knowledge: the client of the knowledge base.
    :param period: s of wall time between two batches.
    :param name: of the thread, and in the log.
    """

    def __init__(self, knowledge: Any, period: float, name: str) -> None:
        self._knowledge = knowledge
        self._period = period
        self._name = name
        self._changed = threading.Condition()  # guards the fields below
        self._facts = SensedFacts()
        self._refused: Set[Fact] = set()
        self._retry_at = 0.0  # monotonic, s
        self._patience = RETRY
        self._closed = False
        self._thread = start_thread(f"teller of {name}", self._work)

    def sense(self, facts: Dict[Fact, Value]) -> None:
        """Takes what a sensor says."""
        with self._changed:
            if self._facts.sense(facts):
                self._changed.notify_all()

    def send_again(self, names: Sequence[str] = ()) -> None:
        """Another client changed these predicates; none: all of them."""
        with self._changed:
            if self._facts.forget_sent(names):
                self._changed.notify_all()

    def objects_appeared(self) -> None:
        """What was refused may be right now."""
        with self._changed:
            self._retry_at, self._patience = 0.0, RETRY
            self._changed.notify_all()

    def close(self) -> None:
        """Ends sending."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _work(self) -> None:
        while not rospy.is_shutdown():
            with self._changed:
                self._changed.wait_for(
                    lambda: self._facts.has_news or self._closed or self._due(), self._wait()
                )
                if self._closed:
                    return
                if self._due():
                    self._facts.keep_news(self._refused)
                    self._refused = set()
                news = self._facts.take_news()
            if not news:
                continue
            began = time.monotonic()
            self._note(news, self._send(news))
            with self._changed:
                left = self._period - (time.monotonic() - began)
                self._changed.wait_for(lambda: self._closed, max(0.0, left))

    def _due(self) -> bool:
        return bool(self._refused) and time.monotonic() >= self._retry_at

    def _wait(self) -> float:
        """Seconds until something may be due; bounded, because a shutdown does not notify this condition."""
        return min(1.0, max(0.001, self._retry_at - time.monotonic())) if self._refused else 1.0

    def _note(self, news: Dict[Fact, Value], left: Dict[Fact, Value]) -> None:
        with self._changed:
            self._refused = (self._refused - news.keys()) | left.keys()
            if left:
                self._retry_at = time.monotonic() + self._patience
                self._patience = min(2 * self._patience, LONGEST_RETRY)
            elif not self._refused:
                self._patience = RETRY

    def _send(self, news: Dict[Fact, Value]) -> Dict[Fact, Value]:
        """Sends facts, one by one when they are refused together; returns those that were refused."""
        try:
            self._knowledge.update([_update(sensed, value) for sensed, value in news.items()])
            return {}
        except ServiceError as error:
            return self._gone(news, error)
        except REFUSED as error:
            self._log(error)
        left = dict(news)
        for sensed, value in news.items() if len(news) > 1 else ():
            try:
                self._knowledge.update([_update(sensed, value)])
                del left[sensed]
            except REFUSED:
                continue
            except ServiceError as error:
                return self._gone(left, error)
        return left

    def _gone(self, left: Dict[Fact, Value], error: Exception) -> Dict[Fact, Value]:
        self._log(error)
        with self._changed:
            self._patience = RETRY  # one that is started again gets everything soon
        return left

    def _log(self, error: Exception) -> None:
        rospy.logerr_throttle_identical(LOG_PERIOD, f"{self._name}: {error}")


def _update(sensed: Fact, value: Value) -> Update:
    name, objects = sensed
    if isinstance(value, bool):
        return Update(ADD, fact(name, *objects, negative=not value))
    return Update(ADD, function_value(name, objects, float(value)))
