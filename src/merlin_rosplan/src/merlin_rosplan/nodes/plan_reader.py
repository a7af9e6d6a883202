# SPDX-License-Identifier: Apache-2.0
"""Makes ROSPlan's plan messages of plan text, with what the knowledge base knows."""

from typing import Dict, List, Set, Tuple

from diagnostic_msgs.msg import KeyValue
from rosplan_dispatch_msgs.msg import ActionDispatch, CompletePlan, EsterelPlan

from merlin_pddl.plan_text import AFTER, PlanStep, PlanTextError, parse_plan
from merlin_pddl.text_reader import suggestion
from merlin_rosplan.dispatch.operator_model import ActionModel, BindingError, PlanTerm
from merlin_rosplan.dispatch.plan_graph import TimedValue
from merlin_rosplan.dispatch.plan_graph_builder import build_graph
from merlin_rosplan.dispatcher.plan_knowledge import PlanKnowledge, PlanKnowledgeError
from merlin_rosplan.messages.plan_graph_messages import graph_to_message

LiftedAndGround = Tuple[ActionModel, ActionModel]

#: What is wrong with a plan, or with the answers of the knowledge base; each with a text that says it.
ERRORS = (PlanTextError, PlanKnowledgeError, BindingError)


class PlanReader:
    """Reads plans for the domain of one knowledge base. For one thread at a time.

    :param knowledge_base: its global name.
    """

    def __init__(self, knowledge_base: str) -> None:
        self._knowledge = PlanKnowledge(knowledge_base)
        self._free = 0  # from here on no plan has had an action of this id

    def actions(self, text: str) -> CompletePlan:
        """A list of actions, in the order of time.

        :param text: the plan.
        :raises: one of :data:`ERRORS`.
        """
        steps = parse_plan(text)
        return CompletePlan(plan=self._messages(text, steps, self._ground(steps)))

    def graph(self, text: str, epsilon: float, full_graph_limit: float, as_rosplan: bool) -> EsterelPlan:
        """A graph of starts and ends, with the timed literals that the knowledge base waits for.

        :param text: the plan.
        :param epsilon: s between two happenings that need an order.
        :param full_graph_limit: actions; the graph of a longer plan has no edges that others imply.
        :param as_rosplan: the edges that ROSPlan draws, and no more.
        :raises: one of :data:`ERRORS`.
        """
        steps = parse_plan(text)
        actions = self._ground(steps)
        timed = self._knowledge.timed() if steps else []
        ground = [action for _, action in actions]
        values: Dict[PlanTerm, float] = {}
        if any(isinstance(entry, TimedValue) for entry in timed):
            values = self._knowledge.values(_compared(ground))
        reduce = len(steps) > full_graph_limit
        graph = build_graph(steps, ground, timed, epsilon, reduce, values, as_rosplan)
        return graph_to_message(graph, self._messages(text, steps, actions))

    def _messages(
        self, text: str, steps: List[PlanStep], actions: List[LiftedAndGround]
    ) -> List[ActionDispatch]:
        """The actions of a plan; parameters carry the operator's labels.

        Ids count from 0. Those of a plan that follows what runs now differ from all before.
        """
        first = self._free if text.startswith(AFTER) else 0
        self._free = max(self._free, first + len(steps))
        return [
            ActionDispatch(
                action_id=first + index,
                name=step.name,
                parameters=[
                    KeyValue(key=label, value=value) for label, value in zip(operator.labels, step.arguments)
                ],
                duration=step.duration,
                dispatch_time=step.time,
            )
            for index, (step, (operator, _)) in enumerate(zip(steps, actions))
        ]

    def _ground(self, steps: List[PlanStep]) -> List[LiftedAndGround]:
        operators: Dict[str, ActionModel] = {}
        actions: List[LiftedAndGround] = []
        objects = self._knowledge.objects() if any(step.arguments for step in steps) else frozenset()
        for step in steps:
            unknown = next((each for each in step.arguments if each.lower() not in objects), None)
            if unknown is not None:
                raise PlanTextError(
                    f"line {step.line}: {step} names '{unknown}', an object that the knowledge base does not "
                    f"know{suggestion(unknown, objects)}"
                )
            try:
                if step.name not in operators:
                    operators[step.name] = self._knowledge.operator(step.name)
                operator = operators[step.name]
                actions.append((operator, operator.ground(operator.bind(step.arguments, step.duration))))
            except BindingError as error:
                raise BindingError(f"line {step.line}: {error}") from None
            except PlanKnowledgeError as error:
                raise PlanKnowledgeError(f"line {step.line}: {error}") from None
        return actions


def _compared(actions: List[ActionModel]) -> Set[str]:
    """Names of the functions in the actions' comparisons."""
    return {
        name
        for action in actions
        for conditions in (action.at_start, action.over_all, action.at_end)
        for entry in conditions.comparisons
        for name in entry.functions
    }
