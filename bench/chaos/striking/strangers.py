# SPDX-License-Identifier: Apache-2.0
"""Strokes of what is not MERLIN's: forged messages, sensors that fall silent, an operator at the page."""

import json
import threading
import time
import urllib.error
import urllib.request
from typing import Dict, List, Tuple

from chaos.faults import Fault
from chaos.judging import events
from chaos.judging.events import Event
from chaos.striking.stroke import Stroke
from chaos.under_test.system import System

#: s until what a foreign node publishes has its subscribers.
CONNECTED = 10.0
#: s that the page's own script waits for the answer to a stop.
PAGE_PATIENCE = 6.0
HTTP_OK = 200


class ForgedPause(Stroke):
    """A foreign node says without end that the simulator is paused; that is heard before the fault."""

    def __init__(self, system: System, fault: Fault) -> None:
        super().__init__(system, fault)
        position = system.log.position()
        system.tell_client(do="forge")
        system.log.wait_for(
            position,
            lambda event: True if event.kind in ("forged", "failed") else None,
            time.monotonic() + CONNECTED,
            time.monotonic,
        )

    def end(self) -> None:
        """Ends it."""
        self._system.tell_client(do="forge_no_more")


class CancelAhead(Stroke):
    """A foreign node cancels all goals of an action up to a time that is still to come."""

    def strike(self) -> None:
        """Has the client publish it."""
        self._system.tell_client(do="cancel_ahead", action=self._fault.on, ahead=self._fault.amount)


class HalfOpen(Stroke):
    """Nothing comes any more on a topic of the robot's sensors, although its connections stay."""

    def strike(self) -> None:
        """Has the simulator keep it back."""
        self._system.tell_client(do="mute", topic=self._fault.on, muted=True)

    def end(self) -> None:
        """Has it come again."""
        self._system.tell_client(do="mute", topic=self._fault.on, muted=False)


class PageStop(Stroke):
    """An operator presses *Stop and hold* on the page, and *Release* when all is seen."""

    def strike(self) -> None:
        """Asks as the page's script does."""
        # Ends with the answer, at the latest after PAGE_PATIENCE.
        threading.Thread(target=self._ask, args=("stop",), name="page", daemon=True).start()

    def help(self) -> List[str]:
        """Releases the base."""
        done = self._ask("release")
        return ["released at the page" if done else "not released at the page"]

    def _ask(self, what: str) -> bool:
        asked = time.monotonic()
        status, words = ask_page(self._system.page, what)
        answer: Dict[str, object] = {"what": what, "status": status, "words": words, "asked": asked}
        self._system.log.add(Event(time.monotonic(), events.PAGE, answer))
        return status == HTTP_OK


def ask_page(page: Tuple[str, str], what: str) -> Tuple[int, str]:
    """What the page answers: status and words; 0 when it does not.

    :param page: its address, and the token of an operator.
    """
    address, token = page
    headers = {"Content-Type": "application/json", "X-Merlin-Token": token, "Origin": address}
    request = urllib.request.Request(f"{address}/control/{what}", b"{}", headers, method="POST")
    try:
        with urllib.request.urlopen(request, timeout=PAGE_PATIENCE) as answer:
            return answer.status, str(json.loads(answer.read()).get("done", ""))
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode(errors="replace")
    except (OSError, ValueError) as error:
        return 0, f"no answer: {error}"
