# SPDX-License-Identifier: Apache-2.0
"""What is waited for: names that are to be announced before something begins, a part that is gone."""

import threading
from typing import Callable, Iterable, List, Optional


class Awaited:
    """The names that are still missing. Thread-safe.

    :param names: that have to be announced.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._changed = threading.Condition()  # guards the names
        self._missing = list(dict.fromkeys(names))

    def heard(self, name: str) -> None:
        """Notes that a name was announced; only awaited ones count."""
        with self._changed:
            if name in self._missing:
                self._missing.remove(name)
                self._changed.notify_all()

    def wait(self, wait_for: Callable[[threading.Condition, Callable[[], bool]], object]) -> List[str]:
        """Waits for all names.

        :param wait_for: waits, with the condition held, until the predicate is true or the wait is over, as
            :meth:`merlin_ros.deadline.Deadline.wait`.
        :return: those that are missing in the end, in the given order.
        """
        with self._changed:
            wait_for(self._changed, lambda: not self._missing)
            return list(self._missing)


class Absence:
    """One deadline for all losses of a part that follow each other: a return does not begin it anew.

    The next loss is a new absence when the part has stayed for as long as it would have been waited for.
    """

    def __init__(self) -> None:
        self._since = self._back = float("-inf")  # s
        self.losses = 0
        """Losses of the present absence."""

    def lost(self, now: float, limit: float) -> Optional[float]:
        """The part is gone.

        :param now: s, of a clock that is never set back.
        :param limit: s for which it is waited for.
        :return: s for which it is still waited for; None: the deadline passed before this loss.
        """
        if now - self._back >= limit:
            self._since, self.losses = now, 0
        self.losses += 1
        left = self._since + limit - now
        return left if left > 0 or self.losses == 1 else None

    def back(self, now: float) -> None:
        """The part is there again."""
        self._back = now
