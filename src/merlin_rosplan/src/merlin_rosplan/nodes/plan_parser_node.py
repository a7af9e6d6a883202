# SPDX-License-Identifier: Apache-2.0
"""ROSPlan's parsing interface: plan text in, a list of actions or a plan graph out."""

import functools
import threading
import time
from typing import TYPE_CHECKING, Any, Type

import rospy
from rosplan_dispatch_msgs.msg import CompletePlan, EsterelPlan
from rosplan_dispatch_msgs.srv import ParsingService, ParsingServiceRequest, ParsingServiceResponse
from std_msgs.msg import String
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse, Trigger

from merlin_ros.call_scope import CallScope
from merlin_rosplan.transport.component import Component
from merlin_rosplan.transport.handover import Handover, digest_service

if TYPE_CHECKING:  # what reads a plan is imported when the node serves
    from merlin_rosplan.nodes.plan_reader import PlanReader

IN_FLIGHT = 0.5  # s for which a call waits for a plan that may be on its way
ANSWER = 0.8  # s of wall time for the whole answer to clients of ROSPlan: many wait one second


class PlanParser(Component):
    """Base of both parsers: services ``parse_plan`` and ``parse_plan_from_file``, topic ``complete_plan``."""

    plan_class: Type[Any] = CompletePlan

    def __init__(self, scope: str) -> None:
        super().__init__(scope)
        self._state = threading.Condition()  # guards the two fields below
        self._text = ""
        self._new = False
        self._parsing = threading.Lock()  # one plan at a time, published in the order of the calls
        self._strict = self.flag("strict", True)
        self.read_params()
        topic = self.resolve(str(self.param("plan_topic", "complete_plan")))
        self._plan = self.publisher(topic, self.plan_class, queue_size=1, latch=True)
        self._hand_over = self.own(Handover.sender(topic))
        self.service(digest_service(topic), Trigger, self._hand_over.answer_digest)
        self._planner_topic = self.resolve(str(self.param("planner_topic", "planner_output")))
        self._outputs = self.own(Handover.receiver(self._planner_topic, self._receive))
        self.subscriber(self._planner_topic, String, self._outputs.from_topic, queue_size=1)
        self.service("parse_plan", Empty, self._serve)
        self.service("parse_plan_from_file", ParsingService, self._serve_file)

    def prepare(self) -> None:
        """Imports what the first plan needs."""
        _ = self._reader

    def on_shutdown(self) -> None:
        """Ends a waiting call."""
        with self._state:
            self._state.notify_all()

    def read_params(self) -> None:
        """For subclasses: reads their parameters, before the first call can come."""

    def message(self, reader: "PlanReader", text: str) -> Any:
        """The message for a plan.

        :raises: one of the reader's errors.
        """
        raise NotImplementedError

    @functools.cached_property
    def _reader(self) -> "PlanReader":
        from merlin_rosplan.nodes.plan_reader import PlanReader

        return PlanReader(self.knowledge_base)

    def _receive(self, message: String) -> None:
        with self._state:
            self._text, self._new = message.data, True
            self._state.notify_all()

    def _serve(self, _: EmptyRequest) -> EmptyResponse:
        with CallScope(None if self._strict else ANSWER):
            return self._answer()

    def _answer(self) -> EmptyResponse:
        begin = time.monotonic()
        self._outputs.catch_up(None if self._strict else IN_FLIGHT)
        patience = IN_FLIGHT if self._strict else max(0.0, IN_FLIGHT - (time.monotonic() - begin))
        with self._state:
            self._state.wait_for(lambda: self._new or self.closed, timeout=patience)
            text, new, self._new = self._text, self._new, False
        if new:
            try:
                self._parse(text, "the planner's output")
            except rospy.ServiceException:
                with self._state:  # a second call must not succeed without a plan
                    self._new = self._new or self._text == text
                raise
        elif text:
            rospy.logwarn("%s: parse_plan: nothing new since the last plan; nothing is published", self.scope)
        elif self._strict:
            raise rospy.ServiceException(f"no plan was received on {self._planner_topic}")
        else:
            rospy.logwarn("%s: parse_plan: no plan was received on %s", self.scope, self._planner_topic)
        return EmptyResponse()

    def _serve_file(self, request: ParsingServiceRequest) -> ParsingServiceResponse:
        try:
            with open(request.plan_path, encoding="utf-8-sig", errors="replace") as file:
                text = file.read()
            self._parse(text, request.plan_path)
        except (OSError, ValueError) as error:  # ValueError: a path with a null byte
            reason = getattr(error, "strerror", None) or error
            rospy.logerr("%s: cannot read %r: %s", self.scope, request.plan_path[:200], reason)
            if self._strict:
                return ParsingServiceResponse(plan_parsed=False)
            self._parse("", "nothing")  # as ROSPlan: what cannot be read is an empty plan
        except rospy.ServiceException:  # it is in the log
            return ParsingServiceResponse(plan_parsed=False)
        return ParsingServiceResponse(plan_parsed=True)

    def _parse(self, text: str, source: str) -> None:
        """Reads a plan and publishes it.

        :raises rospy.ServiceException: it cannot be read or does not fit the domain.
        """
        from merlin_rosplan.nodes.plan_reader import ERRORS

        with self._parsing:
            started = time.monotonic()
            try:
                plan = self.message(self._reader, text)
            except ERRORS as error:
                reason = f"cannot parse {source}: {error}"
                rospy.logerr("%s: %s", self.scope, reason)
                raise rospy.ServiceException(reason) from error
            self._hand_over.hand_over(plan)
            self._plan.publish(plan)
        rospy.logdebug(  # a line at INFO costs as much as the parsing
            "%s: a plan parsed in %.1f ms", self.scope, 1e3 * (time.monotonic() - started)
        )


class SimplePlanParser(PlanParser):
    """Publishes a CompletePlan: a list of actions."""

    def message(self, reader: "PlanReader", text: str) -> CompletePlan:
        """The list."""
        return reader.actions(text)


class EsterelPlanParser(PlanParser):
    """Publishes an EsterelPlan: a graph of starts and ends with time bounds."""

    plan_class = EsterelPlan

    def read_params(self) -> None:
        """The parameters of the graph."""
        self._epsilon = self.number("epsilon_time", 0.01, 0.0)
        self._full_graph_limit = self.number("full_graph_limit", 50 if self._strict else 200, 0)

    def message(self, reader: "PlanReader", text: str) -> EsterelPlan:
        """The graph."""
        return reader.graph(text, self._epsilon, self._full_graph_limit, not self._strict)
