# SPDX-License-Identifier: Apache-2.0
"""What executions of one operator change in the knowledge, and what undoes it: events in, changes out.

For a knowledge base that cannot apply the effects of an action by itself.
"""

from typing import Callable, Dict, Iterable, List, Mapping, NamedTuple, Sequence, Tuple

from merlin_actions.core.ending import Closing


class FactChange(NamedTuple):
    """A fact becomes true, or false."""

    becomes_true: bool
    name: str
    arguments: Tuple[str, ...] = ()


class EffectChanges:
    """The changes of one operator. Not thread-safe.

    :param start, end: the effects at its start and its end; arguments are variables or constants.
    :param plain: ROSPlan reports the effects of a plain operator as those at its start. They come true when
        it has ended.
    """

    def __init__(self, start: Sequence[FactChange], end: Sequence[FactChange], plain: bool) -> None:
        self._start = [] if plain else list(start)
        self._end = list(start if plain else end)
        self._undo: Dict[str, List[FactChange]] = {}  # token → what undoes the start effects
        self._take_back: Dict[str, List[FactChange]] = {}  # token → what undoes the facts of its run

    def open(
        self,
        token: str,
        binding: Mapping[str, str],
        while_running: Sequence[FactChange],
        true_now: Callable[[Sequence[FactChange]], Sequence[bool]],
    ) -> List[FactChange]:
        """An execution begins.

        :param binding: variable → object.
        :param while_running: what holds until it ends.
        :param true_now: whether the fact of each change is true.
        """
        start, meanwhile = self._ground(self._start, binding), in_order(while_running)
        self._undo[token] = _reverse(start, true_now)
        self._take_back[token] = _reverse(meanwhile, true_now)
        return [*start, *meanwhile]

    def close(
        self, token: str, binding: Mapping[str, str], closing: Closing, if_interrupted: Sequence[FactChange]
    ) -> List[FactChange]:
        """An execution has ended.

        :param if_interrupted: literals that hold after an interruption; none: the start effects are undone.
        """
        undo, changes = self._undo.pop(token, []), self._take_back.pop(token, [])
        if closing is Closing.END:
            return changes + self._ground(self._end, binding)
        if closing is Closing.INTERRUPT and if_interrupted:
            return changes + in_order(if_interrupted)
        return changes + undo

    @staticmethod
    def _ground(changes: Sequence[FactChange], binding: Mapping[str, str]) -> List[FactChange]:
        return in_order(
            change._replace(arguments=tuple(binding.get(each, each) for each in change.arguments))
            for change in changes
        )


def in_order(changes: Iterable[FactChange]) -> List[FactChange]:
    """Deletions first: a fact that is deleted and added is true afterwards."""
    return sorted(changes, key=lambda change: change.becomes_true)


def _reverse(
    changes: Sequence[FactChange], true_now: Callable[[Sequence[FactChange]], Sequence[bool]]
) -> List[FactChange]:
    """What undoes some changes: only of what they change now."""
    return [
        change._replace(becomes_true=was_true)
        for change, was_true in zip(changes, true_now(changes) if changes else ())
        if was_true != change.becomes_true
    ]
