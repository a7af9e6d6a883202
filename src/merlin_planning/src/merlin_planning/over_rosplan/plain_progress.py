"""The book of a dispatch whose dispatcher says nothing: is it this plan, and does it go on?"""

from typing import Mapping, Optional, Set

from merlin_planning.dispatch_progress import DispatchAnswer, DispatchProgress, Ground


class PlainProgress(DispatchProgress):
    """Judges from the dispatched actions and their answers alone. Not thread-safe.

    :param first: the action that the plan begins with; None: not known.
    :param takers: operators whose interfaces say when they take an action; those of this dispatch are added.
    """

    def __init__(self, first: Optional[Ground], takers: Set[str]) -> None:
        super().__init__()
        self._first, self._takers = first, takers

    @property
    def other_plan(self) -> bool:
        """Whether what was dispatched first is not what the plan begins with; also when nothing was."""
        return self._first is not None and self._seen != self._first

    @property
    def stands(self) -> bool:
        """Whether nothing is under way, as far as the answers say.

        An action that nothing has taken does not count where its interface would have said so: ROSPlan's
        dispatchers publish with a queue of one, which drops what is sent close behind another message.
        """
        running = any(
            action.id in self._taken or action.name.lower() not in self._takers
            for action in self.running.values()
        )
        return not running and all(len(answers) > 1 for answers in self._early.values())

    def answered(
        self, action_id: int, plan_id: int, answer: DispatchAnswer, information: Mapping[str, str]
    ) -> bool:
        """Notes too which interfaces say that they take an action."""
        ends = super().answered(action_id, plan_id, answer, information)
        action = self.running.get(action_id)
        if action is not None and action_id in self._taken:
            self._takers.add(action.name.lower())
        return ends
