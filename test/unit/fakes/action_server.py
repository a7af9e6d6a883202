# SPDX-License-Identifier: Apache-2.0
"""Takes the place of the action server that a state uses: it ends goals as a test says."""

import threading
from typing import Any, Callable, List, Optional, Tuple

from actionlib_msgs.msg import GoalStatus

from smach import UserData


class Sent:
    """A goal at the server, which ends as the server says, at once or after a cancel."""

    def __init__(self, server: "Server", on_done: Callable[[Any], None]) -> None:
        self.status, self.text, self.result = server.end
        self.done = threading.Event()
        self.id, self.said, self.on_cancel = "mine", "", ""
        self.cancels = 0
        self._server, self._on_done = server, on_done

    def finish(self) -> None:
        self.done.set()
        self._on_done(self)

    def cancel(self) -> None:
        self.cancels += 1
        self.said = self.on_cancel or self.said
        if self._server.stops:
            self.finish()

    def wait(self, timeout: Optional[float] = None) -> bool:
        return self.done.is_set()


class Server:
    """Takes the place of an action client and its server."""

    def __init__(self) -> None:
        self.name = "/server"
        self.there = True
        self.end: Tuple[int, str, Any] = (GoalStatus.SUCCEEDED, "", None)
        self.at_once = True
        self.stops = True
        self.goals: List[Any] = []
        self.sents: List[Sent] = []
        self.owners: List[Optional[str]] = []
        self.given_up: List[str] = []
        self.on_goal: Callable[[], None] = lambda: None

    def wait_for_server(self, timeout: float, unless: Callable[[], bool]) -> bool:
        return self.there

    def absence(self, waited: float) -> str:
        return f"not there within {waited:g} s"

    def send(self, goal: Any, on_done: Callable[[Any], None], owner: Optional[str]) -> Sent:
        self.goals.append(goal)
        self.owners.append(owner)
        sent = Sent(self, on_done)
        self.sents.append(sent)
        if self.at_once:
            sent.finish()
        self.on_goal()
        return sent

    def give_up(self, sent: Sent, reason: str) -> None:
        self.given_up.append(reason)


def userdata(**values: Any) -> UserData:
    made = UserData()
    for key, value in values.items():
        made[key] = value
    return made
