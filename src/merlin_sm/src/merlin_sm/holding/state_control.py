# SPDX-License-Identifier: Apache-2.0
"""What operators have said about a state of a machine: where its run is, and how they ask it to end."""

import threading
from typing import Any, Callable, Dict, List, Optional, Sequence

from merlin_sm.userdata_keys import remapping_of

#: Where the run of a state is: it does not run; it is held before it is entered; it runs; it has ended, and
#: waits until an operator confirms its outcome.
OUT, HELD, RUNS, ENDED = range(4)


class Machine:
    """One instance of a machine."""


class Wish:
    """A request to end a state with an outcome.

    :param outcome: with which one.
    :param by: the operator.
    """

    def __init__(self, outcome: str, by: str) -> None:
        self.outcome, self.by = outcome, by
        self.reached = threading.Event()  # the preempt of the running state has returned


class StateControl:
    """A state of a machine.

    :param machine: its outermost one.
    :param path: of the state: ``NAVIGATE/DRIVE``.
    :param state: the state.
    :param within: the containers around it, outermost first.
    """

    # Many are made, and each entry of a state writes to one.
    __slots__ = (
        "__weakref__", "machine", "path", "state", "within", "levels", "request_preempt",
        "stage", "marked", "cancelled", "wish", "outcome",
    )  # fmt: skip

    def __init__(self, machine: Machine, path: str, state: Any, within: Sequence[Any]) -> None:
        self.machine, self.path, self.state, self.within = machine, path, state, within
        self.levels: Dict[str, int] = getattr(state, "autonomy_levels", {})
        self.request_preempt: Callable[[], None] = state.request_preempt
        # Written by the run itself without a lock; the fields below are guarded by the lock of Outcomes.
        self.stage = OUT
        self.marked = False  # whether there is, or was in this run, a wish or a cancel
        self.cancelled = False  # it was preempted by its machine, in this run
        self.wish: Optional[Wish] = None
        self.outcome = ""  # with which it has ended, while it waits

    def is_cancelled(self) -> bool:
        """Whether its machine is being preempted, or something around it."""
        return (
            self.cancelled
            or any(container.preempt_requested() for container in self.within)
            # A wish that has preempted it does not count as a cancel.
            or (self.wish is None and bool(self.state.preempt_requested()))
        )

    def unset(self) -> List[str]:
        """The output keys of the state that nothing has set in the userdata of its machine."""
        userdata = self.within[-1].userdata
        names = remapping_of(self.within[-1], self.state)
        keys = self.state.get_registered_output_keys()
        return [key for key in keys if names.get(key, key) not in userdata]
