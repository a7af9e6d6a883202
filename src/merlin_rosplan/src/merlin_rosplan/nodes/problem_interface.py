# SPDX-License-Identifier: Apache-2.0
"""The problem interface: asks the knowledge base for everything and publishes it as a PDDL problem."""

import functools
import os
import threading
from typing import TYPE_CHECKING

import rospy
from rosplan_dispatch_msgs.srv import ProblemService, ProblemServiceRequest, ProblemServiceResponse
from std_msgs.msg import String
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse, Trigger

from merlin_ros.master.master_link import MasterSilent, get_param
from merlin_rosplan.planning.planner_files import replace_file
from merlin_rosplan.transport.component import Component, ComponentError
from merlin_rosplan.transport.handover import Handover, digest_service

if TYPE_CHECKING:  # what reads and writes a problem is imported when the node serves
    from merlin_rosplan.nodes.world_reader import WorldReader


class ProblemWriteError(Exception):
    """The problem cannot be generated; the text says why."""


class ProblemInterface(Component):
    """The problem interface as a component. See the README for its names and parameters.

    :raises ComponentError: another planning language than PDDL is asked for.
    """

    def __init__(self, scope: str) -> None:
        super().__init__(scope)
        language = str(self.param("planning_language", "")).lower()
        extension = os.path.splitext(self._path(""))[1].lower()
        if extension in (".rddl", ".hddl") or (not extension and language not in ("", "pddl")):
            raise ComponentError(f"only PDDL problems can be written, not {language or extension}")
        # Held while a problem is generated: file and topic show the same problem.
        self._generating = threading.Lock()
        topic = self.resolve(str(self.param("problem_topic", "problem_instance")))
        self._hand_over = self.own(Handover.sender(topic))
        self._publisher = self.publisher(topic, String, queue_size=1, latch=True)
        self.service(digest_service(topic), Trigger, self._hand_over.answer_digest)
        self.service("problem_generation_server", Empty, self._generate)
        self.service("problem_generation_server_params", ProblemService, self._generate_with)

    def prepare(self) -> None:
        """Imports what the first problem needs."""
        from merlin_pddl import problem_writer  # noqa: F401

        _ = self._world

    @functools.cached_property
    def _world(self) -> "WorldReader":
        from merlin_rosplan.nodes.world_reader import WorldReader

        reader: WorldReader = self.own(WorldReader(self.knowledge_base))
        return reader

    def _path(self, wanted: str) -> str:
        if wanted:
            return wanted
        try:
            return str(get_param(self.resolve("problem_path"), ""))  # read anew each time, as ROSPlan does
        except MasterSilent:  # and it was not set when there was a master
            return ""

    def _generate(self, _request: EmptyRequest) -> EmptyResponse:
        try:
            self.generate(self._path(""))
        except ProblemWriteError as error:
            rospy.logerr("%s: %s", self.scope, error)
            raise rospy.ServiceException(str(error)) from error
        return EmptyResponse()

    def _generate_with(self, request: ProblemServiceRequest) -> ProblemServiceResponse:
        try:
            text = self.generate(self._path(request.problem_path))
        except ProblemWriteError as error:
            rospy.logerr("%s: %s", self.scope, error)
            return ProblemServiceResponse(False, str(error) if request.problem_string_response else "")
        return ProblemServiceResponse(True, text if request.problem_string_response else "")

    def generate(self, path: str = "") -> str:
        """Writes the problem to a file (none when the path is empty), publishes it and returns it.

        :raises ProblemWriteError: the knowledge base does not answer, or the file cannot be written.
        """
        from merlin_pddl.knowledge import Instance
        from merlin_pddl.problem_writer import write_problem
        from merlin_rosplan.messages.knowledge_snapshot import KnowledgeBaseError

        with self._generating:
            try:
                domain, problem = self._world.snapshot()
            except KnowledgeBaseError as error:
                raise ProblemWriteError(str(error)) from error
            for instance in problem.instance_goals:
                rospy.logwarn("%s: PDDL has no goal that %s exists; left out", self.scope, instance.text())
            for row in problem.timed:
                if isinstance(row.item, Instance):
                    text = row.item.text()
                    rospy.logwarn("%s: PDDL cannot say that %s appears later; left out", self.scope, text)
            text = write_problem(problem, domain)
            if path:
                _write(path, text)
            self._hand_over.hand_over(String(text))
            self._publisher.publish(String(text))
            return text


def _write(path: str, text: str) -> None:
    try:
        os.makedirs(os.path.dirname(os.path.abspath(path)), exist_ok=True)
        replace_file(path, text)
    except (OSError, ValueError) as error:  # ValueError: a path with a null byte
        reason = getattr(error, "strerror", None) or error
        raise ProblemWriteError(f"the problem file {path[:200]} cannot be written: {reason}") from error
