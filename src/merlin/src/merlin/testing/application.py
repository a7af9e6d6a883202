# SPDX-License-Identifier: Apache-2.0
"""An application below a test: everything of its launch file but robot and mission."""

import contextlib
import os
import signal
import subprocess
from pathlib import Path
from typing import IO, List, Tuple

from rosplan_knowledge_msgs.msg import KnowledgeItem

from merlin.launch_request import LaunchError, file_of_package, find_launch_file, known_arguments
from merlin.local_names import launch_tool
from merlin_executor.executor_client import MerlinExecutorClient
from merlin_executor.mission.readiness import NotReady, wait_for_robot
from merlin_planning.knowledge_client import ADD, REMOVE, Update, knowledge_client
from merlin_planning.knowledge_text import parse_goal, to_pddl

#: Arguments for a launch file, where it has them: the test is the robot and the mission.
ARGUMENTS = {"on": "robot", "mission": "false", "monitor": "false", "guard": "false", "state_file": "run"}
READY = 60.0  # s for each part to be there
END = 20.0  # s for all of it to end
TAIL = 3000  # characters of its log that a failure shows


class Application:
    """A launch file that runs, on the master of this process.

    :param words: a launch file, or a package and a launch file, and its arguments, ``name:=value``.
    :param log: takes what it prints.
    :raises LaunchError: when there is no such file, or it does not get ready; the text ends with its log.
    """

    def __init__(self, words: Tuple[str, ...], log: IO[str]) -> None:
        files = [word for word in words if ":=" not in word]
        given = dict(word.split(":=", 1) for word in words if ":=" in word)
        file = file_of_package(*files) if len(files) == 2 else find_launch_file(files[0])
        known = known_arguments(file)
        passed = {**{name: value for name, value in ARGUMENTS.items() if name in known}, **given}
        self._process = subprocess.Popen(
            [*launch_tool("roslaunch"), str(file), *(f"{name}:={value}" for name, value in passed.items())],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            self._knowledge = knowledge_client()
            wait_for_robot(self._knowledge, MerlinExecutorClient(), None, (), READY)
        except NotReady as error:
            self.end()
            said = Path(log.name).read_text(encoding="utf-8", errors="replace")
            raise LaunchError(f"{file.name}: {error}\n{said[-TAIL:]}") from error
        self._begin = self._state()

    def restore(self) -> None:
        """Brings the knowledge back to what it was when the application was ready."""
        now = {to_pddl(item): item for item in self._state()}
        begin = {to_pddl(item): item for item in self._begin}
        updates = [
            Update(REMOVE, item)
            for text, item in now.items()
            if text not in begin and item.knowledge_type == KnowledgeItem.FACT
        ]
        updates += [Update(ADD, item) for text, item in begin.items() if text not in now]
        self._knowledge.update(updates)

    def holds(self, *facts: str) -> bool:
        """Whether facts hold in the knowledge base: ``holds("(checked kitchen)")``.

        :raises ValueError: for text that is not PDDL.
        """
        return all(self._knowledge.query([item for fact in facts for item in parse_goal(fact)]))

    def end(self) -> None:
        """Ends all of it."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(END)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _state(self) -> List[KnowledgeItem]:
        return [*self._knowledge.propositions(), *self._knowledge.functions()]
