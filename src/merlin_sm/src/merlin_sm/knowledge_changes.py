"""Changes of knowledge as PDDL text: ``(and (checked kitchen) (not (open door)) (= (battery) 20))``."""

from typing import List

from rosplan_knowledge_msgs.msg import DomainInequality, ExprBase, KnowledgeItem

from merlin_sm.knowledge_client import ADD, REMOVE, Update, function_value
from merlin_sm.knowledge_text import PDDLSyntaxError, parse_goal, to_pddl


def parse_changes(text: str) -> List[Update]:
    """What makes a text true: facts to add and to remove, values to set.

    :raises PDDLSyntaxError: when it is something else than facts, ``not``, values and ``and`` of them.
    """
    return [_update(item) for item in parse_goal(text)]


def _update(item: KnowledgeItem) -> Update:
    if item.knowledge_type == KnowledgeItem.INEQUALITY:
        return Update(ADD, _value(item))
    kind = REMOVE if item.is_negative else ADD
    item.is_negative = False
    return Update(kind, item)


def _value(item: KnowledgeItem) -> KnowledgeItem:
    left, right = item.ineq.LHS.tokens, item.ineq.RHS.tokens
    if (
        item.ineq.comparison_type != DomainInequality.EQUALS
        or [token.expr_type for token in left] != [ExprBase.FUNCTION]
        or [token.expr_type for token in right] != [ExprBase.CONSTANT]
    ):
        raise PDDLSyntaxError(f"{to_pddl(item)} sets no value; write (= (battery) 20)")
    function = left[0].function
    return function_value(
        function.name, [entry.value for entry in function.typed_parameters], right[0].constant
    )
