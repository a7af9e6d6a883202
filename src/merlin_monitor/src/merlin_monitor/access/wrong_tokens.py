"""Wrong tokens cost time and are reported; right ones never wait."""

import asyncio
import time
from typing import Callable, Dict, NamedTuple

FIRST_DELAY, LONGEST_DELAY = 0.5, 3.0  # s that a wrong token is answered later; each one doubles it
FORGET = 600.0  # s after the last wrong token of an address
REPORT_EVERY = 5.0  # s between two complaints about an address
MOST_ADDRESSES = 1000


class _Address(NamedTuple):
    wrong: int
    last: float
    reported: float


class WrongTokens:
    """Counts wrong tokens by the address that they come from. For one thread, that of the server.

    :param report: takes an address and how many wrong tokens came from it, for the history and the log.
    """

    def __init__(self, report: Callable[[str, int], None]) -> None:
        self._report = report
        self._addresses: Dict[str, _Address] = {}

    async def slow_down(self, address: str) -> None:
        """Notes a wrong token, and returns when it may be answered."""
        await asyncio.sleep(self.note(address, time.monotonic()))

    def note(self, address: str, now: float) -> float:
        """Notes a wrong token.

        :param now: s of ``time.monotonic``.
        :return: s until it may be answered.
        """
        known = self._addresses.get(address, _Address(0, now, -REPORT_EVERY))
        count = 1 if now - known.last > FORGET else known.wrong + 1
        reported = known.reported
        if count == 1 or now - reported >= REPORT_EVERY:
            reported = now
            self._report(address, count)
        if len(self._addresses) >= MOST_ADDRESSES and address not in self._addresses:
            self._addresses.pop(next(iter(self._addresses)))
        self._addresses[address] = _Address(count, now, reported)
        return float(min(LONGEST_DELAY, FIRST_DELAY * 2 ** min(count - 1, 10)))
