"""Settles executions whose bridge has ended: which, and when. Pure.

An execution that is open in the knowledge base's journal while no plan is dispatched belongs to a bridge that
was ended. The bridge that comes back settles it (docs/reliability.md); where none comes, the Executor does.
"""

from typing import Collection, Dict, List, NamedTuple

#: s of running time that the bridges have to settle their executions themselves.
BRIDGE_GRACE = 5.0
#: How often the Executor tries to settle one.
ATTEMPTS = 3


class Look(NamedTuple):
    """What a look at the journal asks for."""

    settle: List[str]
    """Tokens of the executions to settle now."""
    wait: float
    """s until the next look at the latest; 0 with nothing to settle: everything is put right, or given up."""
    stuck: List[str]
    """Tokens of the executions that cannot be settled."""

    @property
    def done(self) -> bool:
        """Whether nothing is left to wait for."""
        return not self.settle and self.wait <= 0.0


class Leftovers:
    """Decides about the open executions in one recovery."""

    def __init__(self) -> None:
        self._since: Dict[str, float] = {}
        self._tried: Dict[str, int] = {}

    def look(self, now: float, open_tokens: Collection[str]) -> Look:
        """Looks at the journal.

        :param now: s of running time.
        :param open_tokens: of the executions that are open now, oldest first.
        """
        self._since = {token: self._since.get(token, now) for token in open_tokens}
        due = [token for token in open_tokens if now - self._since[token] >= BRIDGE_GRACE]
        settle = [token for token in due if self._tried.get(token, 0) < ATTEMPTS]
        stuck = [token for token in due if token not in settle]
        for token in settle:
            self._tried[token] = self._tried.get(token, 0) + 1
        waiting = [BRIDGE_GRACE - (now - self._since[token]) for token in open_tokens if token not in due]
        return Look(settle, min(waiting, default=0.0), stuck)
