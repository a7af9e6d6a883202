# SPDX-License-Identifier: Apache-2.0
"""A state that changes what the robot knows."""

from typing import Any, Optional, Sequence

from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant
from merlin_sm.states.merlin_state import FAILURES, SUCCEEDED, MerlinState
from merlin_sm.states.text_keys import filled, keys_of
from merlin_sm.userdata_keys import check_lists


class KnowledgeState(MerlinState, MerlinROSPlanAssistant):
    """Removes and adds facts in one transaction.

    :param add: PDDL facts; ``{key}`` is replaced by the userdata of that name.
    :param remove: likewise.
    :param keys: the userdata keys that the facts may name; None: those that they name.
    """

    def __init__(
        self, add: Sequence[str] = (), remove: Sequence[str] = (), keys: Optional[Sequence[str]] = None
    ) -> None:
        check_lists(add=add, remove=remove)
        super().__init__(input_keys=keys_of([*add, *remove], keys))
        self.changes = (*add, *remove)
        self._add = list(add)
        self._remove = list(remove)

    def run(self, userdata: Any) -> str:
        """Applies the change."""
        try:
            added, removed = (
                [filled(each, userdata) for each in texts] for texts in (self._add, self._remove)
            )
            self.change_facts(add=added, remove=removed)
        except FAILURES as error:
            return self.fail(str(error))
        return SUCCEEDED
