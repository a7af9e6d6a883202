# SPDX-License-Identifier: Apache-2.0
"""The sections of the present: the line that says what the robot does and why, and the queue of goals."""

from typing import Any, Dict, Iterable, List, Mapping, Optional, Tuple

from merlin_monitor.state.freshness import LOST, Freshness
from merlin_monitor.state.guard_section import GUARD, HELD_WORDS, KEPT
from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.machine_section import MachineSection, held_words, unconfirmed_words
from merlin_monitor.state.plan_section import PlanSection
from merlin_monitor.state.request_times import RequestTimes, Shown
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.fact_text import action_text
from merlin_monitor.text.phrase import Phrase, in_english, say, with_reason
from merlin_monitor.text.request_words import (
    ENDED,
    ENDS,
    EXECUTOR_STATES,
    HELD_BEFORE,
    MARKS,
    MISSION_STATES,
    OF_PLANNER,
    ON_INTERRUPT,
    OUTCOMES,
    PAUSED,
    STAGES,
    cancel_words,
    name_of,
    sender_of,
)
from merlin_monitor.truth.worst_truth import LIVE, MISSION, Facts, TaskPace, lost_words, worst_truth

NOW, QUEUE = "now", "queue"
#: Fields of the messages that the state has as they are.
_OF_STATUS = ("request", "priority", "by", "stage", "replans", "reason", "paused", "held", "waits")
_OF_QUEUE = ("request", "priority", "interrupted", "by", "survives")


class NowSection:
    """Keeps the sections ``now`` and ``queue`` of the state.

    :param plan: that is being carried out; its wording is that of this section, too.
    :param machines: that carry it out.
    :param freshness: knows whether the Executor runs.
    """

    def __init__(
        self,
        tree: StateTree,
        report: Reporter,
        plan: PlanSection,
        machines: MachineSection,
        freshness: Freshness,
    ) -> None:
        self._tree = tree
        self._report = report
        self._plan = plan
        self._wording = plan.wording
        self._machines = machines
        self._freshness = freshness
        self._plan_request = ""  # that the shown plan belongs to
        self._mission: Dict[str, Any] = {}
        self._mission_node = ""
        self._pace = TaskPace()
        self._executor: Dict[str, Any] = {}
        self._request_times = RequestTimes()
        self._queued: Optional[Dict[str, Dict[str, Any]]] = None  # what waits, in order; None: not heard yet
        self._kept: Mapping[str, Any] = {}  # the section of an earlier life
        tree.set(QUEUE, "waiting", [])
        self.refresh()

    def remember(self, kept: Mapping[str, Any]) -> None:
        """Takes the section of an earlier life of the monitor: what is still so is not reported again."""
        self._kept = kept
        self._pace.take_up(kept.get("mission") or {})

    def mission(self, message: Any, at: float, node: str = "") -> None:
        """Takes a message with the fields of merlin_msgs/MissionStatus.

        :param node: that sent it; its name separates another client's requests from the mission's.
        """
        self._freshness.heard(MISSION)
        self._mission_node = node
        state = name_of(MISSION_STATES, message.state)
        before = self._mission or self._kept.get("mission") or {}
        told = {name: getattr(message, name) for name in ("task", "tasks", "description")}
        self._mission = {"name": message.mission, "state": state, **told}
        self._pace.task(message.task, at)
        if any(before.get(field) != value for field, value in self._mission.items()):
            task = self._task() if state == "running" else ""
            said = say("{mission} {state}", mission=message.mission, state=say(state))
            said = say("{what}, {more}", what=said, more=task) if task else said
            mark = MARKS.get(state, "failure") if state in ENDED else ""
            self._report(sentence("mission", with_reason(said, message.description), at, mark))
            if state in ENDED:
                # The end of the mission says more than that of its last request.
                self._tree.set(NOW, "last", None)
        pace = self._pace.shown() if message.tasks and state not in ENDED else {}
        self._tree.set(NOW, "mission", {**self._mission, **pace})
        self.refresh()

    def executor(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/ExecutorStatus."""
        self._freshness.heard(NOW)
        before = self._executor or self._kept.get("executor") or {}
        if not self._executor and before.get("request"):
            self._plan_request = before["request"]
            for each in self._running(before):
                self._request_times.remember({"began": before.get("began", at), **each})
        known = {each["request"] for each in self._running(before)}
        words = self._goals(message.goals)
        self._executor = {
            **{name: getattr(message, name) for name in _OF_STATUS},
            "state": name_of(EXECUTOR_STATES, message.state),
            "goals": list(message.goals),
            "words": words,
            "together": [self._with(words, each, at) for each in message.together],
            "done": message.steps_done,
            "total": message.steps_total,
            "breakpoints": list(message.breakpoints),
            **self._running_times(message, words, at),
            "running": [_action(each) for each in message.running],
        }
        for each in self._running(self._executor):
            if each["request"] not in known:
                resumed = self._request_times.begin(each["request"], each["began"], each["goals"])
                goals = each["words"] or say("a request")
                begun = (
                    say("goes on with “{goals}”", goals=goals)
                    if resumed
                    else say("“{goals}” asked for by {client}", goals=goals, client=self._asked_by(each))
                )
                self._report(sentence("goal", begun, at))
        if message.request != before.get("request"):
            if message.request not in known:
                self._plan.request_changed()
            self._plan_request = message.request or self._plan_request
        elif message.replans > before.get("replans", 0):
            self._plan.replanned(message.reason, at)
        self._plan.carried_out(message.request, message.steps_total)
        if message.held and message.held != before.get("held"):
            self._report(sentence("control", self._held(), at))
        self.refresh()

    def knows(self, request: str) -> bool:
        """Whether a status or the queue has named a request."""
        return bool(self._request_times.goals(request))

    def result(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/ExecuteActionResult: a request has ended."""
        identity = message.status.goal_id.id
        began, goals = self._request_times.began(identity) or (at, self._request_times.goals(identity))
        began = min(began, at)  # simulated time can be set back
        outcome = name_of(OUTCOMES, message.result.outcome)
        reason = message.result.reason or message.status.text
        words = self._goals(goals)
        self._request_times.end(identity, at, outcome)
        self._tree.set(QUEUE, "ended", self._request_times.ended())
        if identity == self._plan_request:
            self._plan.request_ended(identity)
        what = words or say("a request")
        seconds = f"{at - began:.1f} s"
        said = say("“{goals}”: {outcome} after {time}", goals=what, outcome=say(outcome), time=seconds)
        achieved, own = outcome in ("succeeded", "already true"), self._plan.planners_words
        said = said if achieved else with_reason(said, self._wording.reason(reason))
        of_planner = outcome in OF_PLANNER and not (own and reason.endswith(own))
        detail = {"began": began, "ended": at, "outcome": outcome, "lane": "goal"}
        label = {"label": ", ".join(goals), "words": what, "reason": reason}
        self._report(sentence("goal", said, at, MARKS.get(outcome, "failure"), **detail, **label))
        last = {"goals": goals, "words": words, "outcome": outcome, "reason": reason, "at": at}
        visitors = "" if achieved or of_planner else self._for_visitors(reason)
        self._tree.set(NOW, "last", {**last, "said": visitors, "seconds": at - began})

    def cancel(self, message: Any, at: float, node: str) -> None:
        """Takes a message with the fields of actionlib_msgs/GoalID: a client takes its request back.

        :param node: that sent it.
        """
        words = self._goals(self._request_times.goals(message.id))
        self._report(sentence("goal", cancel_words(self._named(node), message.id, words), at))

    def queue(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/GoalQueue."""
        self._freshness.heard(QUEUE)
        waiting = [
            {
                **{name: getattr(request, name) for name in _OF_QUEUE},
                "goals": list(request.goals),
                "words": self._goals(request.goals),
                "on_interrupt": ON_INTERRUPT.get(request.on_interrupt, "resume"),
                "queued": request.queued.to_sec(),
                **self._waiting_times(request),
                "kept": self._wording.reason(request.waits),
            }
            for request in message.requests
        ]
        before = self._queued
        self._queued = {request["request"]: request for request in waiting}
        if before is not None:  # what comes first was so before the monitor began
            for identity, request in self._queued.items():
                if request["interrupted"] and not before.get(identity, {}).get("interrupted"):
                    self._interrupted(request, [self._executor, *waiting, *before.values()], at)
        self._tell_queue()

    def _interrupted(self, request: Dict[str, Any], others: Iterable[Dict[str, Any]], at: float) -> None:
        """Reports which request replaced another; that one may run, wait, or have waited just now."""
        goals = request["words"] or say("a request")
        urgent = [each for each in others if each.get("request") and each["priority"] > request["priority"]]
        if not urgent:
            self._report(sentence("goal", say("“{goals}” interrupted", goals=goals), at))
            return
        first = max(urgent, key=lambda other: int(other["priority"]))
        phrase = say(
            "“{goals}” interrupted by the more urgent “{other}”, asked for by {client}",
            goals=goals,
            other=first["words"] or say("a request"),
            client=self._asked_by(first),
        )
        self._report(sentence("goal", phrase, at))

    def reword(self) -> None:
        """Makes the words of all goals anew."""
        for request in [*self._running(self._executor), *(self._queued or {}).values()]:
            if request:
                request["words"] = self._goals(request["goals"])
        self.refresh()

    def refresh(self) -> None:
        """Says anew what the robot does, and why."""
        if self._executor:
            self._executor["mission"] = not self._executor["request"] or self._of_mission(self._executor)
            self._tree.set(NOW, "executor", self._executor)
        self._tell_queue()
        doing, because, step = self._sentence()
        guard = self._tree.get(GUARD) or {}
        lost = self._freshness.lost()
        machines = self._machines
        truth = worst_truth(
            Facts(
                doing,
                because,
                step,
                task=self._mission and self._mission["description"] or "",
                executor=self._executor,
                mission=self._mission,
                waits=bool(self._executor.get("held") or machines.held or machines.unconfirmed),
                acts=bool(self._actions()),
                drives=guard.get("state") in ("passing", "holding") or bool(self._tree.get("map", "goal")),
                lost=lost,
                stopped=guard.get(HELD_WORDS, ""),
                kept=guard.get(KEPT, ""),
            )
        )
        said = {"doing": truth.doing, "because": truth.because, "step": truth.step}
        silent = self._freshness.others_silent()
        trouble = [
            lost_words(owner, self._mission.get("name", ""), wrong)
            for owner, wrong in (self._tree.get(NOW, LOST) or {}).items()
            if owner != truth.blamed
        ]
        trouble += [say("{node} does not answer", node=node) for node in silent]
        truths = {
            "trouble": [in_english(each) for each in trouble],
            "trouble_said": trouble,
            **{name: in_english(words) for name, words in said.items()},
            "said": said,
            "chain": self._chain(),
            **{name: getattr(truth, name) for name in ("state", "tone", "known", "expected")},
            "silent_nodes": silent,
            "active": self._executor.get("state", "idle") != "idle",
        }
        self._tree.put(NOW, **truths)  # at once: no page shows the words of one and the colour of another

    def _tell_queue(self) -> None:
        """Says of each request that waits what it waits for, and who asked for it."""
        executor = self._executor
        waits = say("waits")
        if executor.get("waits"):
            waits = with_reason(waits, executor["waits"])
        elif executor.get("held") and not executor["request"]:
            waits = say("waits at a breakpoint")
        elif executor.get("paused"):
            waits = say("waits until the robot is resumed")
        elif executor.get("request"):
            waits = self._until(executor)
        shown, now = [], self._tree.get("meta", "time") or 0.0
        for request in (self._queued or {}).values():
            if request["not_before"] > now:
                waits = say("waits")  # for its time, which is shown beside
            shown.append({**request, "waits": request["kept"] or waits, "by": self._asked_by(request)})
            waits = self._until(request)
        self._tree.set(QUEUE, "waiting", shown)

    # --- words ---------------------------------------------------------------------------------------------

    def _actions(self) -> List[Dict[str, Any]]:
        running = self._executor.get("running")
        if running:
            return running
        current = self._plan.current
        # Over another executive than ours the plan's feedback is all there is.
        return [current] if current is not None and not self._executor else []

    def _sentence(self) -> Tuple[Phrase, Phrase, Phrase]:
        actions = self._actions()
        executor = self._executor
        paused = bool(executor.get("paused"))
        held = self._held()
        if held and not actions and executor.get("state") != "cancelling":
            return held, say("at a breakpoint, until it is let go on"), ""
        machines = [held_words(path) for path in self._machines.held]
        unconfirmed = [unconfirmed_words(*each) for each in self._machines.unconfirmed]
        if (machines or unconfirmed) and executor.get("state") != "cancelling":
            at_breakpoint = say("at a breakpoint, until it is let go on")
            why = at_breakpoint if machines else say("its autonomy level is higher than the present one")
            return [*machines, *unconfirmed], why, self._step(actions)
        if not actions and executor.get("state", "idle") == "idle":
            return (say("paused"), say(PAUSED), "") if paused else (self._idle(), "", "")
        running = self._running(executor) or [executor]
        goals = [word for each in running for word in each.get("words", [])]
        clients = list(dict.fromkeys(self._asked_by(each) for each in running))
        client = clients[0] if len(clients) == 1 else clients
        because = say("for “{goals}”, asked for by {client}", goals=goals, client=client) if goals else ""
        words: List[Phrase] = [self._in_words(action) for action in actions]
        if executor.get("state") == "cancelling":
            doing = say("stopping {what}", what=words) if words else say("stopping")
            return doing, self._for_visitors(executor.get("reason", "")) or because, self._step(actions)
        if actions and held:
            return say("{what}, then {held}", what=words, held=held), because, self._step(actions)
        if actions:
            return say("{what}, then pausing", what=words) if paused else words, because, self._step(actions)
        stage = executor.get("stage", "")
        return say(STAGES.get(stage, stage.replace("_", " ").lower() or "working")), because, ""

    def _held(self) -> Phrase:
        """What a breakpoint holds, an action or a request; empty: nothing."""
        held = self._executor.get("held", "")
        if not held:
            return ""
        # Between two requests it is one that is held.
        words = self._wording.goal if self._executor["state"] == "idle" else self._wording.reason
        return say(HELD_BEFORE, what=self._plan.words_of(held) or words(held))

    def _idle(self) -> Phrase:
        if not self._executor and not self._mission:
            return say("nothing heard yet")
        if self._mission.get("state") == "paused":
            return say("paused")
        if self._mission.get("state") == "starting":
            return say("starting")
        if self._mission.get("state") in ENDED:
            mission = self._mission
            what = self._for_visitors(mission["description"]) or say("no more")
            return say(ENDS[mission["state"]], mission=mission["name"], what=what)
        return say("idle")

    def _in_words(self, action: Dict[str, Any]) -> Phrase:
        return self._wording.action(action["name"], action["parameters"])

    def _goals(self, goals: Iterable[str]) -> List[Phrase]:
        return [self._wording.goal(goal) for goal in goals]

    def _for_visitors(self, reason: str) -> Phrase:
        """A reason in words, without those of the planner, which the section of the plan has."""
        return self._wording.reason(reason, without=self._plan.planners_words)

    def _step(self, actions: List[Dict[str, Any]]) -> Phrase:
        total = self._executor.get("total") or self._plan.count
        if not actions or not total:
            return ""
        texts = [action_text(action) for action in actions]
        numbers = [number for number in map(self._plan.step, texts) if number]
        number: Optional[int] = numbers[0] if numbers else None
        if number is None:
            number = min(total, self._executor.get("done", 0) + 1)
        return say("step {number} of {count}", number=str(number), count=str(total))

    def _with(self, words: List[Phrase], other: Any, at: float) -> Dict[str, Any]:
        """A further request that runs in the plan of the one with these words."""
        own = self._goals(other.goals)
        shown = {
            **{name: getattr(other, name) for name in ("request", "priority", "by")},
            "goals": list(other.goals),
            "words": own,
            "running": True,
            "waits": say("runs with “{goals}”", goals=words),
            **self._running_times(other, own, at),
        }
        return {**shown, "by": self._asked_by(shown)}

    @staticmethod
    def _running(executor: Dict[str, Any]) -> List[Dict[str, Any]]:
        """The requests that run, in one plan."""
        return [executor, *executor.get("together", ())] if executor.get("request") else []

    def _asked_by(self, request: Mapping[str, Any]) -> str:
        """The person on whose behalf a request was sent, or what its client is called."""
        return request.get("by") or self._named(sender_of(request.get("request", "")))

    def _of_mission(self, request: Mapping[str, Any]) -> bool:
        return not request["by"] and self._is_mission(sender_of(request["request"]))

    def _named(self, sender: str) -> str:
        return self._mission["name"] if self._is_mission(sender) else sender

    def _is_mission(self, sender: str) -> bool:
        # Its end may be heard before what it asked for last: the topics are several.
        unsigned = not self._mission_node and self._mission.get("state") in LIVE
        return bool(self._mission) and (self._mission_node == sender or unsigned)

    @staticmethod
    def _until(request: Mapping[str, Any]) -> Phrase:
        return say("waits until “{goals}” has ended", goals=request["words"] or say("a request"))

    def _task(self) -> Phrase:
        mission = self._mission
        if not mission["task"]:
            return ""
        number = str(mission["task"])
        if mission["tasks"]:
            return say("task {number} of {count}", number=number, count=str(mission["tasks"]))
        return say("task {number}", number=number)

    def _chain(self) -> List[List[Phrase]]:
        """The levels from mission to state: name of the level, its words, and the PDDL of them."""
        mission, executor = self._mission, self._executor
        chain: List[List[Phrase]] = []
        if mission and executor.get("mission", True):
            task = self._task()
            name = mission["name"]
            chain.append(["mission", say("{what}, {more}", what=name, more=task) if task else name])
        if executor.get("goals"):
            chain.append(["goal", executor["words"], ", ".join(executor["goals"])])
        actions = self._actions()
        if actions:
            words = [self._in_words(action) for action in actions]
            chain.append(["action", words, ", ".join(map(action_text, actions))])
            leaf = self._machines.active_leaf(actions[0]["name"].replace("-", "_"))
            if leaf:
                chain.append(["state", leaf])
        elif executor.get("stage"):
            stage = executor["stage"]
            chain.append(["stage", say(STAGES[stage]) if stage in STAGES else stage])
        return chain

    def _running_times(self, message: Any, words: List[Phrase], at: float) -> Dict[str, Any]:
        times = self._times(message, "deadline", "expected_end")
        shown = Shown(words, list(message.goals), times["deadline"])
        return {**times, **self._request_times.run(message.request, at, times["expected_end"], shown)}

    def _waiting_times(self, request: Any) -> Dict[str, Any]:
        times = self._times(request, "not_before", "deadline", "expected_begin", "expected_end")
        shown = Shown(self._goals(request.goals), list(request.goals), times["deadline"])
        self._request_times.expect(request.request, times["expected_begin"], times["expected_end"], shown)
        return times

    def _times(self, message: Any, *names: str) -> Dict[str, Any]:
        """Times of a request, s without what the clock was set by; zero: none. And why it is late."""
        jump = self._tree.get("meta", "clock_set") or 0.0
        times = {name: getattr(message, name) for name in names}
        shown = {name: time.to_sec() - jump if time else 0.0 for name, time in times.items()}
        return {**shown, "late": self._wording.reason(message.late)}


def _action(action: Any) -> Dict[str, Any]:
    parameters = [[pair.key, pair.value] for pair in action.parameters]
    return {"id": action.action_id, "name": action.name, "parameters": parameters}
