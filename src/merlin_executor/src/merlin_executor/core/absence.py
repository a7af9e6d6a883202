"""How long a part that is gone is waited for when it comes back and is lost again. Pure."""

from typing import Optional


class Absence:
    """One deadline for all losses that follow each other: a return does not begin it anew.

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
