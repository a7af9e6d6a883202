# SPDX-License-Identifier: Apache-2.0
"""Whether the domain knows the goals that stand literally in a mission."""

from typing import Callable, List

from merlin_pddl.checks.literals import calls_of, literal_fault, literals_of
from merlin_planning.knowledge_client import KnowledgeClient, known_domain
from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant

#: What takes goals -> the place of that argument.
_METHODS = {"achieve": 0, "send": 0, "add_goal_state": 1}
_BASES = (MerlinROSPlanAssistant,)


def goal_faults(mission: type, fault: Callable[[str, str, bool], str]) -> List[str]:
    """One sentence for each goal that domain or problem do not know; a goal that is computed is not seen.

    :param fault: what is wrong with a text, as :func:`merlin_pddl.checks.literals.literal_fault` says it,
        for an operator's name and whether objects may be added.
    """
    adds = calls_of(mission, "add_objects", _BASES)
    return [
        f"{where}: {text}: {said}; correct the goal, or declare it in domain or problem"
        for where, text in literals_of(mission, _METHODS, _BASES)
        for said in [fault(text, "", adds)]
        if said
    ]


def goal_faults_now(mission: type, knowledge: KnowledgeClient) -> List[str]:
    """The same by the domain and the objects of a knowledge base; none where its files are elsewhere.

    :raises merlin_ros.service_proxy.ServiceError: when it does not answer.
    """
    known = known_domain(knowledge)
    return [] if known is None else goal_faults(mission, lambda text, *how: literal_fault(text, *known, *how))
