# SPDX-License-Identifier: Apache-2.0
"""The section of the plan: its steps with state and time, replans, the planner and the dispatcher."""

import math
from typing import Any, Dict, List, Mapping, Optional, Sequence, Set, Tuple

from merlin_monitor.state.history_events import Reporter, sentence
from merlin_monitor.state.plan_steps import Edges, ShownStep
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.fact_text import atom_text
from merlin_monitor.text.phrase import Phrase, in_english, say, with_reason
from merlin_monitor.text.plain_value import plain_text
from merlin_monitor.text.request_words import name_of
from merlin_monitor.text.wording import Wording
from merlin_planning.dispatch_progress import CANCEL_ACTION

SECTION = "plan"
WAITING, DISPATCHED, RUNNING = "waiting", "dispatched", "running"
SUCCEEDED, FAILED, CANCELLED, DROPPED = "succeeded", "failed", "cancelled", "dropped"
ENDED = (SUCCEEDED, FAILED, CANCELLED, DROPPED)
#: Topics overtake each other: the end of a request may come before the dispatch of its last step.
NOT_DISPATCHED = (WAITING, DROPPED)
LATE = 0.5  # s, after which a dispatch, which has no stamp, may be heard
OVERTAKEN = 2.0  # s, by which a dispatch may be heard before its plan
MOST_REPLANS = 20  # that are shown
TOLD_STEPS = 3  # of a plan, in its event
LONGEST_WORDS = 4000  # characters of what a planner printed
_FEEDBACK = {0: FAILED, 1: RUNNING, 3: RUNNING, 2: SUCCEEDED, 4: SUCCEEDED, 10: FAILED}
_PLANNER = ("idle", "planning", "solved", "unsolvable", "timeout", "crashed", "invalid", CANCELLED, "no plan")
_DISPATCHER = ("idle", "running", "cancelling")


class PlanSection:
    """Keeps the section ``plan`` of the state.

    :param wording: makes the words; None: of the names.
    """

    def __init__(self, tree: StateTree, report: Reporter, wording: Optional[Wording] = None) -> None:
        self.wording = wording or Wording()
        self._tree = tree
        self._report = report
        self._steps: Dict[int, Dict[str, Any]] = {}
        self._replaced: Dict[int, Dict[str, Any]] = {}  # the steps of the plan before
        self._edges: Edges = []
        self._dispatch = 0  # number of the dispatch the steps' states belong to; 0: not known
        self._plans = 0
        self._early: Dict[Tuple[int, int], Tuple[int, str, float]] = {}  # feedback that came before its plan
        self._status: Any = None  # the dispatcher's last one
        self._status_at = 0.0  # s of ROS time
        self._kept: Mapping[str, Any] = {}  # the section of an earlier life, until the first plan
        self._missed: List[Tuple[Any, float]] = []  # dispatches of no step that is known, or begun before
        self._begun: Dict[int, int] = {}  # step -> the dispatch that has begun it
        self._over = 0  # dispatch that had ended before the plan was heard; 0: it is followed
        self._ended = ""  # the request that has ended last
        self._earlier: Set[int] = set()  # dispatches of the plan before
        self._skipped = 0  # plans just before this one of which nothing was heard
        self._planned_at = -math.inf  # s of ROS time
        tree.put(SECTION, steps={}, replans=[])

    @property
    def current(self) -> Optional[Dict[str, Any]]:
        """The step that runs, or the last that did."""
        running = [step for step in self._steps.values() if step["state"] in (RUNNING, DISPATCHED)]
        return running[0] if running else None

    def step(self, text: str) -> Optional[int]:
        """The number of a step by its text, from 1; None: it is not in the plan."""
        for number, step in enumerate(self._steps.values(), 1):
            if step["text"] == text and step["state"] not in ENDED:
                return number
        return None

    @property
    def count(self) -> int:
        """How many steps the plan has."""
        return len(self._steps)

    def remember(self, kept: Mapping[str, Any]) -> None:
        """Takes the section of an earlier life of the monitor."""
        self._kept = kept

    def planned(self, steps: List[ShownStep], edges: Edges, at: float) -> None:
        """Takes a new plan."""
        late = not self._plans and self._status is not None and self._status.state
        overtaken = self._status if self._of_another_plan(at) else None
        at_once = bool(self._steps) and at - self._planned_at < OVERTAKEN
        skipped, self._skipped = self._skipped + (not self._begun) if at_once else 0, 0
        self._plans, self._planned_at = self._plans + 1, at
        self._earlier = set(self._begun.values())
        self._dispatch, self._begun, self._over = 0, {}, 0
        missed = [(message, received) for message, received in self._missed if at - received < OVERTAKEN]
        self._missed = []
        if not late:
            kept = {message.plan_id for message in (*(each for each, _ in missed), overtaken) if message}
            # Without a number, an answer may be of the plan before.
            kept |= {key[0] for key, (*_, heard) in self._early.items() if key[0] and at - heard < OVERTAKEN}
            self._early = {key: answer for key, answer in self._early.items() if key[0] in kept}
        self._edges = edges
        self._replaced, self._steps = self._steps, {step.id: self._shown(step) for step in steps}
        self._tree.put(SECTION, number=self._plans, at=at, edges=[[*map(str, edge)] for edge in edges])
        self._show_steps()
        before = [step["text"] for step in self._kept.get("steps", {}).values()]
        if steps and sorted(before) != sorted(step.text for step in steps):
            self._report(sentence("plan", self._words_of_plan(), at))
        for message, received in missed:
            self.dispatched(message, received)
        self._skipped = skipped
        if late:
            self._catch_up()
            return
        if overtaken:
            self.dispatcher(overtaken, self._status_at)
        if self._plans > 1:
            self._kept = {}
        elif self._status is not None:
            self._take_up(self._status)

    def words_of(self, text: str) -> Phrase:
        """The words of a step; empty: the plan has none of this text."""
        return next((step["words"] for step in self._steps.values() if step["text"] == text), "")

    def in_words(self) -> Dict[str, str]:
        """The steps in English words, by their keys; a picture has room for these."""
        return {str(key): in_english(step["words"]) for key, step in self._steps.items()}

    def reword(self) -> None:
        """Makes the words of all steps anew."""
        for step in self._steps.values():
            self._put(step, **self._words(step["name"], step["parameters"]))

    @property
    def planners_words(self) -> str:
        """Why there was no plan, in the words of the planner; empty: not known."""
        return str(self._tree.get(SECTION, "planner", "reason") or "")

    def dispatched(self, message: Any, at: float) -> None:
        """Takes a message with the fields of rosplan_dispatch_msgs/ActionDispatch."""
        if message.name == CANCEL_ACTION:
            return
        self._follow(message.plan_id)
        step = self._steps.get(message.action_id)
        text = atom_text(message.name, [parameter.value for parameter in message.parameters])
        known = step is not None and step["text"] == text
        if known and self._over and message.plan_id != self._over:
            self._take_back()
        begun = self._begun.get(message.action_id, message.plan_id)
        skipped = self._skipped if at - self._planned_at < OVERTAKEN else 0
        earlier = bool({begun, message.plan_id} & self._earlier) and at - self._planned_at < OVERTAKEN
        if skipped and not known:
            self._skipped -= 1
            return
        if known and begun < message.plan_id and (skipped or earlier):
            self._skipped -= not earlier
            self._take_back()
            begun = message.plan_id
        if not known or begun != message.plan_id:
            # Latched, of a plan that was not received, or faster than its plan, which may be the same again.
            self._missed = [*self._missed, (message, at)][-20:]
            return
        assert step is not None
        if step["state"] in NOT_DISPATCHED:
            self._begin(step, message.plan_id, at)
        early = self._early.pop((message.plan_id, message.action_id), None)
        if early is not None:
            self._answer(step, *early)

    def feedback(self, message: Any, at: float) -> None:
        """Takes a message with the fields of rosplan_dispatch_msgs/ActionFeedback."""
        reason = next((pair.value for pair in message.information if pair.key == "reason"), "")
        step = self._steps.get(message.action_id)
        known = message.plan_id in (0, self._begun.get(message.action_id, self._dispatch))
        if step is None or not known or step["state"] in (WAITING, *ENDED):
            # Latched by each interface: of an earlier plan, or of a dispatch that, or whose plan, is late.
            if len(self._early) > 200:
                self._early.clear()
            self._early[message.plan_id, message.action_id] = message.status, reason, at
            return
        self._answer(step, message.status, reason, at)

    def dispatcher(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/DispatchStatus."""
        late = self._status is None
        first = late or not self._status.state
        self._status, self._status_at = message, at
        if message.state:
            self._follow(message.plan_id)
        if first and self._plans == 1:
            self._take_up(message, late and bool(message.state))
        if message.state and self._plans:
            self._show_earlier(message.running)
        now_running = {action.action_id: action for action in message.running}
        for identity, action in now_running.items():
            step = self._steps.get(identity)
            text = atom_text(action.name, [parameter.value for parameter in action.parameters])
            if step is not None and step["text"] == text:
                # Of the dispatcher's own clock only how long ago it was is of use.
                stamps = message.header.stamp, action.dispatched
                began = at - ((stamps[0] - stamps[1]).to_sec() if all(stamps) else 0.0)
                if step["state"] == WAITING:
                    self._begin(step, message.plan_id, began)
                elif self._begun.get(identity) == message.plan_id and began < step["began"] - LATE:
                    self._put(step, began=began)
        shown = {"done": message.steps_done, "total": message.steps_total, "reason": message.reason}
        shown.update(state=name_of(_DISPATCHER, message.state), failed_action=message.failed_action)
        self._tree.set(SECTION, "dispatcher", shown)

    def _of_another_plan(self, at: float) -> bool:
        """Whether the dispatcher has just said what runs, of a plan that is heard only now."""
        status = self._status
        if status is None or not status.state or at - self._status_at >= OVERTAKEN:
            return False
        return status.plan_id not in self._begun.values()

    def _take_back(self) -> None:
        """What has begun, or ended before it was heard, was of a plan before this one, which waits."""
        for identity in self._steps if self._over else self._begun:
            step = self._steps[identity]
            for field in ("began", "ended", "reason"):
                step.pop(field, None)
            self._put(step, state=WAITING)
        self._begun, self._over = {}, 0

    def _begin(self, step: Dict[str, Any], dispatch: int, at: float) -> None:
        self._begun[step["id"]] = dispatch
        self._put(step, state=DISPATCHED, began=at)

    def _show_earlier(self, running: Sequence[Any]) -> None:
        """Shows what goes on of a plan before in front of the one that follows it, whose ids are higher."""
        first = min(self._steps, default=math.inf)
        earlier = {}
        for action in running:
            if action.action_id < first:
                parameters = [(parameter.key, parameter.value) for parameter in action.parameters]
                made = self._shown(ShownStep(action.action_id, action.name, parameters, 0.0, 0.0))
                was = self._replaced.get(action.action_id, {})
                known = was.get("text") == made["text"]
                earlier[action.action_id] = {**was, "start": 0.0} if known else made
        if earlier:
            self._steps = {**earlier, **self._steps}
            self._show_steps()

    def _shown(self, step: ShownStep) -> Dict[str, Any]:
        """A step that waits, as the state has it."""
        return {
            **{name: getattr(step, name) for name in ("id", "name", "text", "start", "duration")},
            **self._words(step.name, step.parameters),
            "parameters": [list(pair) for pair in step.parameters],
            "state": WAITING,
        }

    def _show_steps(self) -> None:
        steps = {str(key): step for key, step in self._steps.items()}
        self._tree.put(SECTION, order=list(steps), steps=steps)

    def planner(self, message: Any, at: float) -> None:
        """Takes a message with the fields of merlin_msgs/PlannerStatus."""
        state = name_of(_PLANNER, message.state)
        before = self._tree.get(SECTION, "planner", "state")
        fields = {name: getattr(message, name) for name in ("planner", "seconds", "reason")}
        self._tree.put(SECTION, "planner", state=state, at=at, **fields)
        if state not in ("idle", "planning") and before is not None:
            said = say(
                "{what}: {state} after {time}",
                what=message.planner or say("the planner"),
                state=say(state),
                time=f"{message.seconds:.2f} s",
            )
            mark = "" if state in ("solved", CANCELLED) else "failure"
            self._report(sentence("plan", with_reason(said, message.reason), at, mark))

    def planner_words(self, text: str) -> None:
        """Takes the planner's output."""
        self._tree.set(SECTION, "planner", "output", plain_text(text, LONGEST_WORDS))

    def replanned(self, reason: str, at: float) -> None:
        """A failed plan is replaced."""
        said = self.wording.reason(reason)
        replans = [*self._tree.get(SECTION, "replans"), {"at": at, "reason": said}]
        self._tree.set(SECTION, "replans", replans[-MOST_REPLANS:])
        why = said or say("the plan failed")
        self._report(sentence("plan", say("planning again: {why}", why=why), at, "replan", reason=reason))

    def request_changed(self) -> None:
        """Another request is served: replans count anew, and the plan of the last one is over."""
        self._tree.set(SECTION, "replans", [])

    def carried_out(self, request: str, steps: int) -> None:
        """A request has a plan of so many steps: that may have been read, and dropped, before it."""
        if request not in ("", self._ended) and steps == len(self._steps) and not self._begun:
            for step in self._steps.values():
                if step["state"] == DROPPED:
                    self._put(step, state=WAITING)

    def request_ended(self, request: str = "") -> None:
        """The request of the plan has ended: what was not dispatched never will be."""
        self._ended = request
        for step in self._steps.values():
            if step["state"] == WAITING:
                self._put(step, state=DROPPED)

    def _words_of_plan(self) -> Phrase:
        """The plan in words: its first steps."""
        steps = [step["words"] for step in self._steps.values()]
        if len(steps) == 1:
            return say("plan of one step: {steps}", steps=steps)
        shown, count = steps[:TOLD_STEPS], str(len(steps))
        if len(steps) > TOLD_STEPS:
            return say("plan of {count} steps, first {steps}", count=count, steps=shown)
        return say("plan of {count} steps: {steps}", count=count, steps=shown)

    def _catch_up(self) -> None:
        """Started in the middle of a dispatch, it gets the latched messages before or after the plan."""
        self.dispatcher(self._status, self._status_at)
        self._take_up(self._status, late=True)
        for (plan_id, identity), (status, reason, received) in list(self._early.items()):
            step = self._steps.get(identity)
            if plan_id == self._dispatch and step is not None:
                self._answer(step, status, reason, received)
        self._early.clear()

    def _take_up(self, status: Any, late: bool = False) -> None:
        """Begun in the middle of a dispatch or after it, the steps that ended are known from the life before.

        Else from the dispatcher: what had to end before a step that runs, and as many more as it counts.

        :param late: the plan was carried out already when it was heard.
        """
        running = {action.action_id: action for action in status.running}
        kept, self._kept = self._kept, {}
        if status.steps_total != len(self._steps) or not running.keys() <= self._steps.keys():
            return  # of another plan
        if not status.state and set(self._begun.values()) - {status.plan_id}:
            return  # the one that had ended is not the one that has begun
        ended = "" if status.state else status.failed_action
        failed = {identity for identity, step in self._steps.items() if step["text"] == ended}
        old = kept.get("steps", {}) if kept.get("dispatch") == status.plan_id else {}
        texts = {str(key): step["text"] for key, step in self._steps.items()}
        if old and all(old.get(key, {}).get("text") == text for key, text in texts.items()):
            self._plans = kept["number"]
            self._tree.put(SECTION, number=self._plans, at=kept["at"])
        elif late:
            self._tree.put(SECTION, at=None)
        for key, was in old.items():
            step = self._steps.get(int(key), {})
            same = was["state"] == SUCCEEDED or int(key) in running
            if step.get("text") == was["text"] and same:
                times = {field: was[field] for field in ("began", "ended") if field in was}
                self._put(step, state=was["state"], **times)
        before = self._before(set(running))
        rest = [identity for identity in self._steps if identity not in before]
        for identity in [*sorted(before, key=list(self._steps).index), *rest]:
            done = [step for step in self._steps.values() if step["state"] == SUCCEEDED]
            step = self._steps[identity]
            left = identity not in {*running, *failed} and step["state"] not in ENDED
            if len(done) < status.steps_done and left:
                self._put(step, state=SUCCEEDED)
        if not status.state:
            self._over = status.plan_id
            for identity, step in self._steps.items():
                if identity in failed:
                    self._put(step, state=FAILED, reason=self.wording.reason(status.reason, step["text"]))
                elif step["state"] not in ENDED:
                    self._put(step, state=DROPPED)

    def _before(self, steps: Set[int]) -> Set[int]:
        """The steps that must precede any of these."""
        found: Set[int] = set()
        new = steps
        while new:
            new = {before for before, after, *_ in self._edges if after in new} - found
            found |= new
        return found - steps

    def _follow(self, plan_id: int) -> None:
        if plan_id:
            self._dispatch = plan_id
            self._tree.set(SECTION, "dispatch", plan_id)

    def _answer(self, step: Dict[str, Any], status: int, reason: str, at: float) -> None:
        state = _FEEDBACK.get(status)
        if state is None or step["state"] in ENDED:
            return
        if state == FAILED and reason == CANCELLED:
            state = CANCELLED
        if state == RUNNING:
            self._put(step, state=RUNNING)
            return
        began = min(step.get("began", at), at)  # simulated time can be set back
        why = self.wording.reason(reason, step["text"])
        self._put(step, state=state, ended=at, reason="" if state == SUCCEEDED else why)
        words, seconds = step["words"], f"{at - began:.1f} s"
        said = say("{what}: {state} after {time}", what=words, state=say(state), time=seconds)
        detail = {"began": began, "ended": at, "outcome": state, "lane": "action"}
        mark = {FAILED: "failure", CANCELLED: "cancel"}.get(state, "")
        said = with_reason(said, why if state == FAILED else "")
        label = {"label": step["text"], "words": words}
        self._report(sentence("action", said, at, mark, **detail, **label, reason=reason))

    def _words(self, name: str, parameters: Sequence[Sequence[str]]) -> Dict[str, Phrase]:
        """The words of a step, and those that do not name its robot."""
        words = self.wording.action(name, parameters)
        does = self.wording.action(name, parameters, subject=False)
        return {"words": words} if does == words else {"words": words, "does": does}

    def _put(self, step: Dict[str, Any], **fields: Any) -> None:
        step.update(fields)
        self._tree.set(SECTION, "steps", str(step["id"]), step)
