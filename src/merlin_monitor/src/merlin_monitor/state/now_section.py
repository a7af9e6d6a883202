"""The sections of the present: the line that says what the robot does and why, and the queue of goals."""

import re
from typing import Any, Dict, List, Optional, Set, Tuple

from merlin_monitor.state.events import Event, Tell
from merlin_monitor.state.freshness import SILENT, Freshness
from merlin_monitor.state.guard_section import GUARD, HELD
from merlin_monitor.state.machine_section import MachineSection
from merlin_monitor.state.plan_section import PlanSection
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.plain_words import action_in_words, listed

NOW, QUEUE = "now", "queue"
MISSION_STATES = ("starting", "running", "paused", "succeeded", "failed", "cancelled")
EXECUTOR_STATES = ("idle", "running", "cancelling")
OUTCOMES = (
    "succeeded",
    "already true",
    "cancelled",
    "dropped",
    "refused",
    "unsolvable",
    "planner timeout",
    "planner error",
    "action failed",
    "cancel timeout",
    "internal",
    "no plan",
)
_STAGES = {
    "ADD_GOALS": "noting the goals",
    "GENERATE_PROBLEM": "writing the problem",
    "PLAN": "planning",
    "PARSE_PLAN": "reading the plan",
    "DISPATCH_PLAN": "starting the next action",
    "REPLAN": "preparing a new plan",
    "REMOVE_GOALS": "clearing up",
}
_ENDS = {"succeeded": "ended", "failed": "failed", "cancelled": "been cancelled"}
_REQUEST = re.compile(r"(?P<node>[^-]+)(?:-[0-9a-f]{12})?-\d+-\d+\.\d+(?:-leased)?\Z")
PAUSED = "no further goal begins until the robot is resumed"
LIVE = ("starting", "running", "paused")
ENDED = ("succeeded", "failed", "cancelled")


class NowSection:
    """Keeps the sections ``now`` and ``queue`` of the state.

    :param plan: that is being carried out.
    :param machines: that carry it out.
    :param freshness: knows whether the Executor is there.
    """

    def __init__(
        self,
        tree: StateTree,
        tell: Tell,
        plan: PlanSection,
        machines: MachineSection,
        freshness: Freshness,
    ) -> None:
        self._tree = tree
        self._tell = tell
        self._plan = plan
        self._machines = machines
        self._freshness = freshness
        self._plan_request = ""  # that the shown plan belongs to
        self._mission: Dict[str, Any] = {}
        self._mission_node = ""
        self._executor: Dict[str, Any] = {}
        self._request_began: Dict[str, Tuple[float, List[str]]] = {}
        self._task_began = 0.0
        self.places: Set[str] = set()
        tree.set(QUEUE, "waiting", [])
        self.refresh()

    def mission(self, message: Any, at: float, node: str = "") -> None:
        """Takes a message with the fields of merlin_msgs/MissionStatus.

        :param node: that sent it; with its name a request of another client is told from the mission's.
        """
        self._mission_node = node
        state = _word(MISSION_STATES, message.state)
        before = self._mission
        self._mission = {
            "name": message.mission,
            "state": state,
            "task": message.task,
            "tasks": message.tasks,
            "description": message.description,
        }
        if before != self._mission:
            of = f" of {message.tasks}" if message.tasks else ""
            task = f", task {message.task}{of}" if message.task and state == "running" else ""
            said = f": {message.description}" if message.description else ""
            self._tell(Event("mission", f"{message.mission} {state}{task}{said}", at))
            if state in ENDED:
                # The end of the mission says more than that of its last request.
                self._tree.set(NOW, "last", None)
        self._tree.set(NOW, "mission", self._mission)
        self.refresh()

    def executor(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/ExecutorStatus."""
        before = self._executor
        self._executor = {
            "state": _word(EXECUTOR_STATES, message.state),
            "request": message.request,
            "goals": list(message.goals),
            "priority": message.priority,
            "stage": message.stage,
            "done": message.steps_done,
            "total": message.steps_total,
            "replans": message.replans,
            "reason": message.reason,
            "paused": message.paused,
            "running": [
                {
                    "id": action.action_id,
                    "name": action.name,
                    "parameters": [[pair.key, pair.value] for pair in action.parameters],
                }
                for action in message.running
            ],
        }
        if message.request != before.get("request"):
            self._plan.request_changed()
            if message.request:
                self._plan_request = message.request
                resumed = message.request in self._request_began
                self._request_began.setdefault(message.request, (at, list(message.goals)))
                what = "gone on with" if resumed else f"asked for by {self._who()}"
                self._tell(Event("goal", f"{listed(message.goals) or 'a request'} {what}", at))
        elif message.replans > before.get("replans", 0):
            self._plan.replanned(message.reason, at)
        self._tree.set(NOW, "executor", self._executor)
        self.refresh()

    def result(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/ExecuteActionResult: a request has ended."""
        identity = message.status.goal_id.id
        began, goals = self._request_began.pop(identity, (at, []))
        if len(self._request_began) > 200:
            self._request_began.clear()
        outcome = _word(OUTCOMES, message.result.outcome)
        reason = message.result.reason or message.status.text
        said = f": {reason}" if reason and outcome not in ("succeeded", "already true") else ""
        label = listed(goals) or "a request"
        if identity == self._plan_request:
            self._plan.request_ended()
        detail = {"began": began, "ended": at, "outcome": outcome, "lane": "goal", "label": label}
        self._tell(Event("goal", f"{label}: {outcome} after {at - began:.1f} s{said}", at, detail))
        self._tree.set(
            NOW,
            "last",
            {"goals": goals, "outcome": outcome, "reason": reason, "at": at, "seconds": at - began},
        )

    def queue(self, message: Any) -> None:
        """Takes a message with the fields of merlin_msgs/GoalQueue."""
        waiting = [
            {
                "request": request.request,
                "goals": list(request.goals),
                "priority": request.priority,
                "on_interrupt": "drop" if request.on_interrupt else "resume",
                "interrupted": request.interrupted,
                "queued": request.queued.to_sec(),
                "by": _sender(request.request),
            }
            for request in message.requests
        ]
        self._tree.set(QUEUE, "waiting", waiting)

    def refresh(self) -> None:
        """Says anew what the robot does, and why."""
        doing, because, step = self._sentence()
        silent = self._tree.get(NOW, SILENT)
        if silent is not None:
            # What was known of it may not be true any more.
            doing, because, step = f"not known: the Executor {silent['what']}", f"before: {doing}", ""
        held = self._tree.get(GUARD, HELD)
        if held:
            # What the Executor does comes second: nothing of it moves the base.
            doing, because = held, f"the Executor: {doing}"
        for name, value in (
            ("trouble", [f"{node} does not answer" for node in self._freshness.others_silent()]),
            ("doing", doing),
            ("because", because),
            ("step", step),
            ("chain", self._chain()),
            ("active", self._executor.get("state", "idle") != "idle"),
        ):
            self._tree.set(NOW, name, value)

    # --- words ---------------------------------------------------------------------------------------------

    def _actions(self) -> List[Dict[str, Any]]:
        running = self._executor.get("running")
        if running:
            return running
        current = self._plan.current
        # Over another executive than ours the plan's feedback is all there is.
        return [current] if current is not None and not self._executor else []

    def _sentence(self) -> Tuple[str, str, str]:
        actions = self._actions()
        executor = self._executor
        paused = bool(executor.get("paused"))
        if not actions and executor.get("state", "idle") == "idle":
            return ("paused", PAUSED, "") if paused else (self._idle(), "", "")
        goals = executor.get("goals", [])
        because = f"because {listed(goals)} was requested by {self._who()}" if goals else ""
        if executor.get("state") == "cancelling":
            doing = "stopping"
            if actions:
                doing += " " + listed([self._in_words(action) for action in actions])
            return doing, executor.get("reason") or because, self._step(actions)
        if actions:
            then = ", then pausing" if paused else ""
            doing = listed([self._in_words(action) for action in actions]) + then
            return doing, because, self._step(actions)
        stage = executor.get("stage", "")
        return _STAGES.get(stage, stage.replace("_", " ").lower() or "working"), because, ""

    def _idle(self) -> str:
        if not self._executor and not self._mission:
            return "nothing heard yet"
        if self._mission.get("state") == "paused":
            return "paused"
        if self._mission.get("state") == "starting":
            return "starting"
        if self._mission.get("state") in ENDED:
            mission = self._mission
            return f"{mission['name']} has {_ENDS[mission['state']]}: {mission['description'] or 'no more'}"
        return "idle"

    def _in_words(self, action: Dict[str, Any]) -> str:
        return action_in_words(action["name"], [tuple(pair) for pair in action["parameters"]], self.places)

    def _step(self, actions: List[Dict[str, Any]]) -> str:
        total = self._executor.get("total") or self._plan.count
        if not actions or not total:
            return ""
        texts = [_text(action) for action in actions]
        numbers = [number for number in map(self._plan.step, texts) if number]
        number: Optional[int] = numbers[0] if numbers else None
        if number is None:
            number = min(total, self._executor.get("done", 0) + 1)
        return f"step {number} of {total}"

    def _who(self) -> str:
        sender = _sender(self._executor.get("request", ""))
        if self._mission.get("state") in LIVE and self._mission_node in ("", sender):
            return self._mission["name"]
        return sender

    def _chain(self) -> List[List[str]]:
        mission, executor = self._mission, self._executor
        chain: List[List[str]] = []
        if mission:
            task = ""
            if mission["task"]:
                task = f", task {mission['task']}" + (f" of {mission['tasks']}" if mission["tasks"] else "")
            chain.append(["mission", f"{mission['name']}{task}"])
        if executor.get("goals"):
            chain.append(["goal", listed(executor["goals"])])
        actions = self._actions()
        if actions:
            chain.append(["action", listed([_text(action) for action in actions])])
            leaf = self._machines.active_leaf(actions[0]["name"].replace("-", "_"))
            if leaf:
                chain.append(["state", leaf])
        elif executor.get("stage"):
            chain.append(["stage", executor["stage"]])
        return chain


def _text(action: Dict[str, Any]) -> str:
    return f"({' '.join([action['name'], *(value for _, value in action['parameters'])])})"


def _sender(request: str) -> str:
    match = _REQUEST.match(request)
    return match.group("node") if match else (request or "somebody")


def _word(words: Tuple[str, ...], number: int) -> str:
    return words[number] if 0 <= number < len(words) else str(number)
