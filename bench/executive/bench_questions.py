# SPDX-License-Identifier: Apache-2.0
"""From a goal to its first action as bench_cancel measures it, while five questions are asked per second."""

import contextlib
import itertools
import threading
import time
from pathlib import Path
from typing import Any, Dict, Iterator

from merlin_msgs.srv import Explain, ExplainRequest

from executive.cancel_cycles import cancel_cycles_by_turns
from merlin_ros.service_proxy import ServiceError, ServiceProxy

CYCLES = 105
NAMES = ("goal_to_dispatch_ms", "cancel_to_stop_ms")
PER_SECOND = 5.0
LIMIT = 60.0  # s
#: What is asked in turn; each has an answer, which may be that it is not known, whatever the robot does.
ASKED = (
    {"question": "doing"},
    {"question": "why", "about": "(checked kitchen)"},
    {"question": "waiting"},
    {"question": "failed"},
    {"question": "what_if", "goals": ["(checked bathroom)"]},
)


@contextlib.contextmanager
def questions(count: Dict[str, float]) -> Iterator[None]:
    """Within it the robot is asked, every 0.2 s from several threads.

    :param count: adds up how many were asked and answered, in how many seconds.
    """
    over = threading.Event()
    turns = itertools.count()
    begin = time.monotonic()

    def ask() -> None:
        service = ServiceProxy("merlin/explain", Explain, timeout=LIMIT)
        while True:
            turn = next(turns)
            if over.wait(max(0.0, begin + turn / PER_SECOND - time.monotonic())):
                return
            count["asked"] = count.get("asked", 0.0) + 1
            with contextlib.suppress(ServiceError):
                service(ExplainRequest(**ASKED[turn % len(ASKED)]))
                count["answered"] = count.get("answered", 0) + 1

    assert ServiceProxy("merlin/explain", Explain).wait(LIMIT), "nothing answers questions"
    askers = [threading.Thread(target=ask, name=f"asker {number}") for number in range(len(ASKED))]
    for asker in askers:
        asker.start()
    try:
        yield
    finally:
        over.set()
        for asker in askers:
            asker.join()
        count["seconds"] = count.get("seconds", 0.0) + time.monotonic() - begin


def measure() -> Dict[str, Any]:
    """The figures without and with questions, by turns, with how many were asked and answered per s."""
    count: Dict[str, float] = {}
    launch = Path(__file__).with_name("questions.launch")
    alone, asked = cancel_cycles_by_turns(launch, CYCLES, longest=3.0, beside=lambda: questions(count))
    return {
        "without questions": {name: alone[name] for name in NAMES},
        "questions": {name: asked[name] for name in NAMES},
        "questions_answered_per_s": round(count.get("answered", 0.0) / count["seconds"], 1),
        "questions_asked_per_s": round(count["asked"] / count["seconds"], 1),
    }
