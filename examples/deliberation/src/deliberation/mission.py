# SPDX-License-Identifier: Apache-2.0
"""The missions of the four problems: reach the goals, through cancels and an urgent request."""

import json
import random
import threading
import time
from pathlib import Path
from typing import Any, Dict, List, Optional, Set, Tuple

import rospy
from merlin_msgs.msg import ExecuteResult
from std_msgs.msg import String

from deliberation.belief import SENSED
from deliberation.house import ANYWHERE, House, State, from_data, holds, mistake_in, words
from deliberation.oracle import expected_actions
from deliberation.problems import Run, problem_of
from merlin_executor.executor_request import ExecutorRequest
from merlin_executor.mission import GoalDispatcher, MissionError, MissionFailed, outcome_name, results_folder
from merlin_ros.work.threads import start_thread

STATE_WAIT = 60.0  # s of wall time for the first state of the simulation
MOST_BEFORE = 4  # actions that begin before a cancel, at most
AGAIN = (ExecuteResult.ACTION_FAILED, ExecuteResult.PLANNER_TIMEOUT)
HELD = (ExecuteResult.SUCCEEDED, ExecuteResult.ALREADY_TRUE)


class Deliberation(GoalDispatcher):
    """Base: sends the goals of a problem. With cancels, an urgent request comes in between as well.

    :cvar number: of the problem.
    :param seed: of the moments of cancels.
    :param cancels: how often the goals are cancelled and sent again.
    :param goals: instead of those of the problem; `none`: those.
    :param urgent: instead of its urgent goals; `none`: those, and with other goals nothing.
    :param attempts: how often goals are sent whose plans have failed too often, or that got none in time.
    :param results: folder.
    :raises ValueError: for text that is not a list of goals.
    """

    number = 0
    servers = ("move_base", "recognize", "pick", "place", "open", "close")

    def __init__(
        self,
        seed: int = 1,
        cancels: int = 0,
        goals: str = "none",
        urgent: str = "none",
        attempts: int = 5,
        results: Path = Path("results/deliberation"),
    ) -> None:
        if cancels < 0 or attempts < 1:
            raise ValueError(
                f"~cancels is {cancels} and ~attempts {attempts}; they have to be at least 0 and 1"
            )
        asked = problem_of(self.number)
        self._seed, self._cancels, self._attempts = seed, cancels, attempts
        self._goals = words(asked.goals if goals == "none" else goals)
        if urgent == "none":
            urgent = asked.urgent if goals == "none" else ""
        self._urgent = words(urgent) if cancels and urgent else []
        self._results = results_folder(results)
        self._changed = threading.Condition()  # guards _data
        self._data: Optional[Dict[str, Any]] = None
        self._replans, self._planning, self._done_urgent, self._done_cancels = 0, 0.0, 0, 0
        self._wrong: List[str] = []
        super().__init__(asked.title, 1)
        rospy.Subscriber("pyrobosim/state", String, self._receive, queue_size=50, tcp_nodelay=True)

    def run(self) -> None:
        """Sends the goals until they hold.

        :raises MissionFailed: when they do not, or a cancel has left something wrong.
        :raises MissionError: when one names what is not in the world.
        """
        self._first, self._began = self._truth(), time.monotonic()
        mistake = mistake_in([*self._goals, *self._urgent], *self._first)
        if mistake:
            raise MissionError(mistake)
        draw = random.Random(self._seed)
        for _ in range(self._cancels):
            request = self.send(texts(self._goals))
            if self._after(draw.randint(1, MOST_BEFORE), request):
                request.cancel()
                self._done_cancels += 1
            request.wait()
            self._book(request.result)
            self._wrong += [f"after a cancel: {each}" for each in self._misjudged()]
        request = self.send(texts(self._goals))
        urgent = None
        if self._urgent and self._after(draw.randint(1, MOST_BEFORE), request):
            urgent = self.send(texts(self._urgent), priority=1)
        self._pursue(self._goals, request, 0)
        if self._urgent:
            self._pursue(self._urgent, urgent, 1)
            self._done_urgent += 1
        self._took = time.monotonic() - self._began

    def _pursue(
        self, goals: List[Tuple[str, ...]], request: Optional[ExecutorRequest], priority: int
    ) -> None:
        """Waits for a request, and sends it again after an outcome that another attempt may change."""
        result = None
        for _ in range(self._attempts):
            request = request or self.send(texts(goals), priority=priority)
            request.wait()
            result = request.result
            self._book(result)
            request = None
            if result is None or result.outcome not in AGAIN:
                break
        if result is None or result.outcome not in HELD:
            reason = f"{outcome_name(result.outcome)}: {result.reason}" if result else "the node shuts down"
            raise MissionFailed(f"{' '.join(texts(goals))}: {reason}", result)

    def _book(self, result: Optional[ExecuteResult]) -> None:
        if result is not None:
            self._replans += result.replans
            self._planning += sum(each.time.to_sec() for each in result.stage_times if each.stage == "PLAN")

    def _receive(self, message: String) -> None:
        with self._changed:
            self._data = json.loads(message.data)
            self._changed.notify_all()

    def _truth(self) -> Tuple[House, State]:
        with self._changed:
            if not self._changed.wait_for(lambda: self._data is not None, STATE_WAIT):
                raise MissionError(
                    f"no state of the simulation within {STATE_WAIT:g} s; does the bridge run?"
                )
            assert self._data is not None
            return from_data(self._data)

    def _after(self, actions: int, request: ExecutorRequest) -> bool:
        """Waits until further actions have begun; False: the request has ended before."""
        ended = threading.Event()

        def wake() -> None:
            request.wait()
            ended.set()
            with self._changed:
                self._changed.notify_all()

        start_thread("request", wake)
        with self._changed:
            assert self._data is not None
            until = self._data["begun"] + actions
            self._changed.wait_for(lambda: ended.is_set() or self._begun() >= until)
        return not ended.is_set()

    def _begun(self) -> int:
        return int(self._data["begun"]) if self._data is not None else 0

    def _misjudged(self) -> List[str]:
        """Where the knowledge differs from what is true: place, hand, what is open, battery, known things."""
        with self._changed:
            self._changed.wait_for(lambda: self._data is not None and not self._data["running"], STATE_WAIT)
        _, state = self._truth()
        known = {name: {tuple(each.strip("()").split()) for each in self.facts(name)} for name in SENSED[:6]}
        expected: Dict[str, Set[Tuple[str, ...]]] = {
            "robot_at": {("robot_at", state.site or ANYWHERE)},
            "holding": {("holding", state.holding)} if state.holding else set(),
            "hand_empty": set() if state.holding else {("hand_empty",)},
            "is_open": {("is_open", name) for name in state.open},
        }
        wrong = [
            f"{name}: known is {sorted(known[name])}, true is {sorted(facts)}"
            for name, facts in expected.items()
            if known[name] != facts
        ]
        battery = self.value("(battery)") or 0.0
        if abs(battery - state.battery) > 0.1:
            wrong.append(f"battery: known is {battery:g}, true is {state.battery:g}")
        where = [(thing, spot) for _, thing, spot in known["is_at"]]
        return wrong + [
            f"{thing} is not at {spot}" for thing, spot in where if state.things.get(thing) != spot
        ]

    def finish(self, succeeded: bool) -> bool:
        """Compares goals and knowledge with the simulation, and writes the run.

        :raises MissionError: when it cannot be written.
        """
        house, first = self._first
        wrong = self._wrong + self._misjudged()
        state, goals = self._truth()[1], [*self._goals, *self._urgent]
        wrong += [
            f"the goal {text} does not hold"
            for text, goal in zip(texts(goals), goals)
            if not holds(goal, state)
        ]
        run = Run(
            self.number,
            self._seed,
            succeeded and not wrong,
            self._begun(),
            int((self._data or {}).get("failed", 0)),
            expected_actions(house, first, goals),
            round(getattr(self, "_took", time.monotonic() - self._began), 2),
            self._replans,
            round(self._planning, 2),
            self._done_cancels,
            self._done_urgent,
            wrong,
        )
        try:
            (self._results / "run.json").write_text(json.dumps(run.as_data()) + "\n", encoding="utf-8")
        except OSError as error:
            raise MissionError(f"the run cannot be written: {error}") from error
        for each in wrong:
            print(f"WRONG: {each}", flush=True)
        return run.solved


class Fetch(Deliberation):
    """Mug and apple on the table: they have to be found."""

    number = 1


class Doors(Deliberation):
    """Mug on the table, book on the desk: doors are closed, and a full hand opens none."""

    number = 2


class Containers(Deliberation):
    """Apple on the table, soap in the bin: things are in closed containers, and actions fail."""

    number = 3


class Battery(Deliberation):
    """These, and the book on the desk, with a battery that has to be charged in time."""

    number = 4


def texts(goals: List[Tuple[str, ...]]) -> List[str]:
    """Goals as PDDL."""
    return [f"(not ({' '.join(goal[1:])}))" if goal[0] == "not" else f"({' '.join(goal)})" for goal in goals]
