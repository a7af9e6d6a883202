"""Why a knowledge base refused an update: ROSPlan's answer has no place for it."""

import threading
from collections import OrderedDict

from std_srvs.srv import TriggerRequest, TriggerResponse

from merlin_rosplan.transport.component import caller

#: How many clients' last refusals are kept.
KEPT = 100


class Refusals:
    """The last refusal of each client, for the client itself. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the field below
        self._reasons: OrderedDict[str, str] = OrderedDict()

    def note(self, client: str, reason: str) -> None:
        """What a client sent was refused."""
        with self._lock:
            self._reasons[client] = reason
            self._reasons.move_to_end(client)
            if len(self._reasons) > KEPT:
                self._reasons.popitem(last=False)

    def answer(self, request: TriggerRequest) -> TriggerResponse:
        """The answer of the service: the last refusal of the client that asks; no success without one."""
        with self._lock:
            reason = self._reasons.get(caller(request))
        return TriggerResponse(reason is not None, reason or "nothing of this client was refused")
