# SPDX-License-Identifier: Apache-2.0
"""A behaviour tree as a state: ticked when something has happened, and preempted at once."""

import threading
from typing import Any, Dict, Iterator, List, Sequence, Tuple

import py_trees
import rospy
from py_trees.common import Status

import smach
from merlin_ros.deadline import Deadline
from merlin_ros.ros_alarm import call_after
from merlin_ros.work.threads import failure_logged
from merlin_sm.merlin_sm import gives_up_with
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, merlin_states
from merlin_sm.trees.state_behaviour import StateBehaviour
from merlin_sm.trees.state_run import StateRun
from merlin_sm.trees.tree_view import Behaviour, Branch

#: Ticks one after the other, each of which changes something, before the tree is called endless.
MOST_TICKS = 1000


class BehaviourTree(Branch):
    """Ticks a tree until its root is SUCCESS (succeeded) or FAILURE (aborted).

    It is ticked when a state of it has ended, after :meth:`wake`, and again at once while a tick changes
    something. No state begins while one that was interrupted still stops. It ends when everything in it has.

    :param root: of the tree.
    :param keys: userdata that it gets from its machine.
    :param period: s of ROS time after which it is ticked although nothing has happened; 0: not at all. A
        behaviour may ask for it too, by an attribute `period`; it counts while the behaviour is RUNNING.
    """

    def __init__(self, root: Behaviour, keys: Sequence[str] = (), period: float = 0.0) -> None:
        if not isinstance(root, Behaviour):
            raise ValueError(f"the root of a tree has to be a behaviour of py_trees, not {root!r}")
        super().__init__(root, keys, (SUCCEEDED, ABORTED, PREEMPTED))
        self.root = root
        self.reason = self.about = ""
        self.given_up = False
        self._period = period
        self._set_up = False
        self._changed = threading.Condition()  # guards the fields below
        self._woken = False
        self._runs: List[StateRun] = []  # that have not ended
        self._unstopped = ""  # why the tree has to end

    def wake(self) -> None:
        """Requests a tick; from any thread, when something that a behaviour looks at has changed."""
        with self._changed:
            self._woken = True
            self._changed.notify_all()

    def request_preempt(self) -> None:
        """Sets the flag and interrupts every state that runs, in the caller's thread."""
        super().request_preempt()
        with self._changed:
            runs = list(self._runs)
        for run in runs:
            run.interrupt()
        self.wake()

    def execute(self, parent_ud: Any = None) -> str:
        """Ticks the tree to its end.

        :param parent_ud: the userdata of the machine.
        :return: succeeded, aborted or preempted.
        :raises Exception: what a behaviour has raised; all others have ended then.
        """
        self._begin(parent_ud)
        outcome = ABORTED
        try:
            self._tick_to_end()
            outcome = self._outcome()
        finally:
            self._stop()
            self.refresh()
            if self._unstopped:
                outcome, self.reason, self.given_up = ABORTED, self._unstopped, False
            self.call_termination_cbs([], outcome)
            if parent_ud is not None:
                for key in self.get_registered_output_keys():
                    if key in self.userdata:
                        parent_ud[key] = self.userdata[key]
        if outcome == PREEMPTED:
            self.service_preempt()
        return outcome

    # --- a run --------------------------------------------------------------------------------------------

    def _begin(self, parent_ud: Any) -> None:
        """Forgets the run of before."""
        self.reason = self._unstopped = ""
        gives_up_with(self, ())
        userdata = smach.UserData()
        for key in self.get_registered_input_keys():
            if parent_ud is not None and key in parent_ud:
                userdata[key] = parent_ud[key]
        self.share(userdata)
        for leaf in self._leaves():
            leaf.machine.userdata = userdata
            for state in merlin_states(leaf.machine):
                state.unstopped = ""
        if not self._set_up:
            self.root.setup_with_descendants()
            self._set_up = True
        self.root.stop(Status.INVALID)
        self.call_start_cbs()

    def _tick_to_end(self) -> None:
        """Ticks until the root has ended, or the tree has to."""
        ticks = 0
        only_board = False
        while not self._over():
            with self._changed:
                self._woken = False
            statuses, board = self._statuses(), _board()
            self.root.tick_once()
            self._start_due()
            self.refresh()
            if self.root.status != Status.RUNNING:
                return
            ticks += 1
            changed = statuses != self._statuses()
            # A write to the blackboard is looked at once: a behaviour may write at each tick.
            only_board = not changed and not only_board and board != _board()
            if not changed and not only_board and self._waits():
                self._wait()
                ticks = 0
            elif ticks >= MOST_TICKS:
                raise RuntimeError(
                    f"tree {self.root.name} was ticked {ticks} times and does not wait for anything; "
                    "let it run a state, or give it a period"
                )

    def _over(self) -> bool:
        return self.preempt_requested() or bool(self._unstopped) or rospy.is_shutdown()

    def _waits(self) -> bool:
        """Whether something will wake it."""
        return self._shortest_period() > 0.0 or any(
            not node.children and node.status == Status.RUNNING for node in self.root.iterate()
        )

    def _wait(self) -> None:
        period = self._shortest_period()
        alarm = None
        if period > 0.0:
            alarm = call_after(period, self.wake, f"period of {self.root.name}")
        with self._changed:
            Deadline(None).wait(self._changed, lambda: self._woken)
        if alarm is not None:
            alarm.shutdown()

    def _shortest_period(self) -> float:
        asked = [
            float(getattr(node, "period", 0.0))
            for node in self.root.iterate()
            if node.status == Status.RUNNING
        ]
        return min([period for period in [self._period, *asked] if period > 0.0], default=0.0)

    def _outcome(self) -> str:
        if self.root.status == Status.SUCCESS:
            return SUCCEEDED
        if self.root.status != Status.FAILURE and self._over():
            self.reason = "cancelled"
            return PREEMPTED
        decisive = list(_decisive(self.root))
        self.reason = "; ".join(
            dict.fromkeys(node.feedback_message or f"{node.name} failed" for node in decisive)
        )
        gives_up_with(self, (leaf.machine for leaf in decisive if isinstance(leaf, StateBehaviour)))
        return ABORTED

    def _stop(self) -> None:
        """Interrupts everything and waits until it has stopped."""
        for node in self.root.iterate():  # children first
            if node.status == Status.RUNNING:
                # Users' code; the others have to be stopped too.
                with failure_logged(f"the end of behaviour {node.name}"):
                    node.stop(Status.INVALID)
                    node.status = Status.INVALID
        with self._changed:
            runs = list(self._runs)
        for run in runs:
            run.interrupt()
        with self._changed:
            Deadline(None).wait(self._changed, lambda: not self._runs)

    # --- states -------------------------------------------------------------------------------------------

    def _leaves(self) -> Iterator[StateBehaviour]:
        return (node for node in self.root.iterate() if isinstance(node, StateBehaviour))

    def _start_due(self) -> None:
        """Starts the states that the last tick has begun, unless something that it interrupted still stops.

        Not within the tick: a selector ticks what it turns to before it interrupts what it leaves.
        """
        with self._changed:
            if self._over() or any(run.interrupted for run in self._runs):
                return
            begun = [leaf.start(self._ended) for leaf in self._leaves() if leaf.due]
            self._runs += begun
        for run in begun:
            run.start(self.wake)

    def _ended(self, run: StateRun) -> None:
        late = [state.reason for state in merlin_states(run.machine) if state.unstopped]
        with self._changed:
            self._runs.remove(run)
            self._unstopped = self._unstopped or "; ".join(late)
            self._changed.notify_all()

    def _report(self, before: List[str]) -> None:
        if self._active:
            self.call_transition_cbs()

    def _statuses(self) -> Tuple[Status, ...]:
        return tuple(node.status for node in self.root.iterate())


def _decisive(node: Behaviour) -> Iterator[Behaviour]:
    """The leaves whose failure made a tree fail; of a selector, the last child decides."""
    failed = [child for child in node.children if child.status == Status.FAILURE]
    if isinstance(node, py_trees.composites.Selector):
        failed = failed[-1:]
    if not failed:
        yield node
    for child in failed:
        yield from _decisive(child)


def _board() -> Dict[str, int]:
    """What stands on the blackboard of py_trees, which all trees of a process share."""
    return {key: id(value) for key, value in list(py_trees.blackboard.Blackboard.storage.items())}
