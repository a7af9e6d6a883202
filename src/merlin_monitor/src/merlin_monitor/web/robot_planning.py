# SPDX-License-Identifier: Apache-2.0
"""What operators ask of planning system and machines: plans, facts, breakpoints, outcomes of states."""

from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Set, Tuple

from merlin_msgs.msg import PlannerStatus
from merlin_msgs.srv import PreviewPlan
from rosplan_knowledge_msgs.msg import DomainOperator, KnowledgeItem

from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.text.fact_text import action_text
from merlin_monitor.text.phrase import Phrase, in_english, say, with_reason
from merlin_monitor.web.page_control import ControlError
from merlin_pddl.breakpoints import BreakpointError
from merlin_planning.knowledge_client import REMOVE, KnowledgeClient, KnowledgeError, Update, parse_changes
from merlin_planning.knowledge_text import PDDLSyntaxError
from merlin_ros.parameters import graph_name
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_sm.breakpoint_client import BreakpointClient, Stepped

Key = Tuple[str, ...]  # name and objects, lower-case
#: Of an operator: what is needed until its end, and what it changes.
_FIELDS = [f"{when}_{kind}_condition" for when in ("over_all", "at_end") for kind in ("simple", "neg")] + [
    f"{when}_{kind}_effects" for when in ("at_start", "at_end") for kind in ("add", "del", "assign")
]


class HandChanges:
    """Changes that are not made yet, beside the knowledge as it is.

    :param knowledge: is asked what holds now.
    :param updates: facts that become true or false, and values.
    :raises ServiceError: the knowledge base does not answer.
    """

    def __init__(self, knowledge: KnowledgeClient, updates: Sequence[Update]) -> None:
        self._knowledge = knowledge
        self.new: List[Update] = []
        """Those that change anything."""
        back = []
        for update in updates:
            before, after = self._before(update.item), _after(update)
            if before != after:
                self.new.append(update)
                if before is not None:  # a number that there was not cannot be taken away
                    back.append(_text(update.item, before))
        self.back = f"(and {' '.join(back)})" if len(back) > 1 else "".join(back)
        """What sets all of it back, as PDDL text; empty: nothing can be set back."""

    def contradicted(self, running: Iterable[Mapping[str, Any]]) -> str:
        """The running actions that need or change the same, as PDDL text; empty: none.

        :param running: name and parameters of each action.
        :raises ServiceError: the knowledge base does not answer.
        """
        changed = {_key(update.item) for update in self.new}
        return "; ".join(
            action_text(action)
            for action in running
            if changed & _touched(self._knowledge.operator(action["name"]), dict(action["parameters"]))
        )

    def _before(self, item: KnowledgeItem) -> Optional[float]:
        if item.knowledge_type == KnowledgeItem.FACT:
            return float(self._knowledge.query([item])[0])
        values = {_key(each): each.function_value for each in self._knowledge.functions(item.attribute_name)}
        return values.get(_key(item))


def _after(update: Update) -> float:
    if update.item.knowledge_type == KnowledgeItem.FACT:
        return float(update.kind != REMOVE)
    return float(update.item.function_value)


def _text(item: KnowledgeItem, value: float) -> str:
    term = f"({' '.join([item.attribute_name, *(pair.value for pair in item.values)])})"
    if item.knowledge_type == KnowledgeItem.FACT:
        return term if value else f"(not {term})"
    return f"(= {term} {value!r})"


def _key(item: KnowledgeItem) -> Key:
    return (item.attribute_name.lower(), *(pair.value.lower() for pair in item.values))


def _touched(operator: DomainOperator, parameters: Dict[str, str]) -> Set[Key]:
    bound = {label.lower(): value.lower() for label, value in parameters.items()}
    found = set()
    for field in _FIELDS:
        for formula in getattr(operator, field):
            term = getattr(formula, "LHS", formula)
            names = [pair.key.lower() for pair in term.typed_parameters]
            found.add((term.name.lower(), *(bound.get(name, name) for name in names)))
    return found


PREVIEW_ANSWERS = 13.0  # s of wall time; the planner stops after 10 s
_NO_PLAN = {
    PlannerStatus.UNSOLVABLE: "There is no plan from here",
    PlannerStatus.NO_PLAN: "No plan was found",
    PlannerStatus.TIMEOUT: "No plan was found in time",
}


class RobotPlanning:
    """A plan that is only shown, facts set by hand, breakpoints, forced outcomes, and the autonomy level.

    Breakpoints stay with the robot, whatever becomes of the page.

    :param state: knows what is shown.
    :param knowledge: its knowledge base.
    :param report: takes an operator and the sentence about what he does, for the history.
    """

    def __init__(
        self, state: MonitorModel, knowledge: KnowledgeClient, report: Callable[[str, Phrase], None]
    ) -> None:
        self._state = state
        self._knowledge = knowledge
        self._report = report
        dispatcher = graph_name("~plan_dispatcher", "rosplan_plan_dispatcher")
        self._breakpoints = BreakpointClient(knowledge, dispatcher=dispatcher)
        planner = graph_name("~planner_interface", "rosplan_planner_interface")
        self._preview = ServiceProxy(f"{planner}/preview_plan", PreviewPlan, timeout=PREVIEW_ANSWERS)

    def plan(self, goal: str, without: Sequence[str], by: str) -> Dict[str, Any]:
        """A plan for a goal from where what runs will have ended; nothing is carried out.

        :param without: actions that it has to do without, as PDDL text.
        :return: a sentence, ``done``, and the plan's steps with their times.
        """
        if not self._preview.available():
            raise ControlError(f"No plan can be shown: nothing offers {self._preview.name}.")
        try:
            running = self._running()
            answer = self._preview(goals=[goal], without=list(without), after=list(running))
        except ServiceError as error:
            raise ControlError(f"No plan can be shown: {error}") from error
        status = answer.status
        left_out = f" without {', '.join(without)}" if without else ""
        looks = say("{client} looks for a plan for “{goal}”", client=by, goal=self._state.wording.goal(goal))
        if without:
            looks = say(
                "{what} without {actions}", what=looks, actions=[self._words(text) for text in without]
            )
        if status.state != PlannerStatus.SOLVED:
            why = f"{_NO_PLAN.get(status.state, 'No plan can be shown')}{left_out}: {status.reason}"
            self._report(by, with_reason(looks, status.reason or why))
            raise ControlError(why)
        steps = [
            {"text": text, "words": self._words(text), "start": start, "duration": duration}
            for text, start, duration in zip(answer.actions, answer.starts, answer.durations)
        ]
        end = max((step["start"] + step["duration"] for step in steps), default=0.0)
        said = f"a plan of {len(steps)} steps, {end:.1f} s" if steps else "the goal holds already"
        found = say("{count} steps, {time}, not carried out", count=str(len(steps)), time=f"{end:.1f} s")
        self._report(by, with_reason(looks, found if steps else say("the goal holds already")))
        plan = {
            "goal": goal,
            "words": self._state.wording.goal(goal),
            "without": list(without),
            "after": list(running.values()),
            "steps": steps,
            "seconds": end,
        }
        return {"done": f"Not carried out: {said}.", "plan": plan}

    def change(self, facts: str, by: str, seen: str) -> str:
        """Makes facts true and false and sets values, in one transaction, and offers to set them back.

        :param seen: the actions that the operator has seen it to contradict.
        """
        try:
            changes = HandChanges(self._knowledge, parse_changes(facts))
            if not changes.new:
                return "All of it is so already: nothing was changed."
            against = changes.contradicted(self._state.tree.get("now", "executor", "running") or [])
            if against and against != seen:
                running = in_english([self._words(text) for text in against.split("; ")])
                raise ControlError(
                    f"Nothing was changed yet: {running} runs, and needs or changes that.", against
                )
            self._knowledge.update(changes.new)
        except (PDDLSyntaxError, KnowledgeError, ServiceError) as error:
            raise ControlError(f"Nothing was changed: {error}") from error
        words = self._state.wording.fact
        self._report(by, say("{client} changes the knowledge: {facts}", client=by, facts=words(facts)))
        back = changes.back
        undo = {"facts": back, "words": words(back)} if back else None
        self._state.inbox.put(self._state.tree.set, "control", "undo", undo)
        return f"The knowledge was changed: {len(changes.new)} of facts and values."

    def _running(self) -> Dict[str, Phrase]:
        """The actions that run, as PDDL text, and in words."""
        running = self._state.tree.get("now", "executor", "running") or []
        return {text: self._words(text) for text in map(action_text, running)}

    def hold_before(self, texts: Sequence[str], by: str) -> str:
        """Replaces the breakpoints."""
        try:
            self._breakpoints.set(texts)
        except BreakpointError as error:
            raise ControlError(f"Not all breakpoints are set: {error}.") from error
        shown = ", ".join(texts) or "nothing"
        kept = ", ".join(texts) or say("nothing")
        self._report(by, say("{client} holds the robot before {what}", client=by, what=kept))
        return f"It is held before {shown}."

    def go_on(self, step: bool, by: str) -> str:
        """Continues from a breakpoint; a step holds the next action or state."""
        try:
            stepped = self._breakpoints.step() if step else Stepped(self._breakpoints.go_on(), "")
        except BreakpointError as error:
            raise ControlError(f"Not continued: {error}.") from error
        if stepped.state:
            self._report(by, say("{client} lets the state {state} begin", client=by, state=stepped.state))
        else:
            begun = "{client} lets one action begin" if step else "{client} lets what is held go on"
            self._report(by, say(begun, client=by))
        return stepped.said

    def leave(self, state: str, outcome: str, within: str, by: str) -> str:
        """Makes a state end with an outcome; its node adds an event to the history when it has left.

        :param outcome: empty: the one that waits is confirmed.
        :param within: the namespace of the node that runs it, with a slash at its end; empty: any.
        """
        try:
            done = self._breakpoints.states.leave(state, outcome, by, within)
        except BreakpointError as error:
            raise ControlError(f"Not done: {error}.") from error
        if outcome:
            wished = say("{client} wishes {outcome} of {state}", client=by, outcome=outcome, state=state)
            self._report(by, wished)
        return done

    def set_autonomy(self, level: str, by: str) -> str:
        """Sets the autonomy level of all machines."""
        try:
            self._breakpoints.states.set_autonomy(level)
        except BreakpointError as error:
            raise ControlError(f"The autonomy level is not set everywhere: {error}.") from error
        self._report(by, say("{client} sets the autonomy level {level}", client=by, level=say(level)))
        return f"The autonomy level is {level}."

    def _words(self, text: str) -> Any:
        """An action in words, with the names of its parameters where the domain is known."""
        name, *objects = text.strip("()").split()
        known: List[Tuple[str, str]] = self._state.tree.get("knowledge", "domain", "operators", name) or []
        if len(known) != len(objects):
            return text
        pairs = [(variable, value) for (variable, _), value in zip(known, objects)]
        return self._state.wording.action(name, pairs)
