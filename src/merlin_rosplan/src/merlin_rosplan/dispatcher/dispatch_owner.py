"""The owner of the running dispatch; a silent owner suspends the dispatch, a lost one cancels it.

A dispatch begun by a service belongs to its caller. A service call has no id that its caller could lease.
Therefore the caller leases a new goal on ``<dispatcher>/dispatch_plan/lease``, before the call or after it,
and that goal stands for the dispatch. Without a lease the dispatch runs to its end. The action server watches
the owner of a goal of ``dispatch_plan_action``.
"""

import threading
from collections import deque
from typing import Deque, List, Optional

import rospy

from merlin_ros.actions.lease import LOSE_AFTER, LeaseChange, LeaseState
from merlin_ros.actions.lease_watch import LeaseWatch
from merlin_ros.actions.ownership import ownership
from merlin_ros.master import master_link
from merlin_ros.master.namesake import living_namesake
from merlin_rosplan.dispatch.dispatch import PlanDispatch

REMEMBERED = 100  # goals of earlier dispatches, which their clients may still hold for a moment


class DispatchOwner:
    """The owner of one dispatch after the other; thread-safe.

    While it is silent no further action starts, and the running ones are suspended; when it is gone the
    dispatch is cancelled.

    :param scope: global name of the dispatcher.
    :param lose_after: s of the owner's silence after which it counts as gone.
    """

    def __init__(self, scope: str, lose_after: float = LOSE_AFTER) -> None:
        self._scope = scope
        self._lock = threading.Lock()  # guards the fields down to _earlier
        self._client: Optional[str] = None
        self._dispatches = 0  # begun so far
        self._goal = ""
        self._silent = ""  # why it may not be there
        self._gone = ""  # why it is gone
        self._dispatch: Optional[PlanDispatch] = None
        self._key = ""
        self._earlier: Deque[str] = deque(maxlen=REMEMBERED)
        self._watch = LeaseWatch(f"{scope}/dispatch_plan/lease", self._lease_changed, lose_after=lose_after)

    def begin(self, client: str) -> None:
        """A dispatch begins.

        :param client: the node that called; empty: not known, or the action server watches it.
        """
        with self._lock:
            self._client, self._dispatch = client, None
            self._dispatches += 1
            self._silent = self._gone = ""
            held = self._held(client)
            self._goal = goal = held[-1] if held else ""
        if goal:
            self._watch.tell(goal)

    def attach(self, dispatch: PlanDispatch, key: str) -> None:
        """The dispatch that it owns is about to run.

        :param key: names it in :data:`merlin_ros.actions.ownership.ownership`, which suspends its actions.
        """
        with self._lock:
            self._dispatch, self._key = dispatch, key
        self._act()

    def end(self) -> None:
        """The dispatch has ended, or did not come to run."""
        with self._lock:
            goal, key = self._goal, self._key
            held = [] if goal else self._held(self._client)
            if held:  # the lease came behind the call; the next dispatch must not take it for its own
                goal = held[0]
            self._client, self._dispatch, self._goal, self._key = None, None, "", ""
            if goal:
                self._earlier.append(goal)
        if goal:
            self._watch.forget(goal)
        ownership.resume(key)

    def changed(self, state: LeaseState, reason: str) -> None:
        """The owner of the present dispatch is silent (SUSPENDED), back (HELD) or gone (LOST)."""
        with self._lock:
            if self._client is None:
                return
            self._silent = "" if state is LeaseState.HELD else reason
            if state is LeaseState.LOST:
                self._gone = f"its owner {self._client} is gone: {reason}"
        self._act()

    def abandoned(self) -> str:
        """Cancels the present dispatch when its owner is gone.

        Asks a node that leases nothing whether it lives, which takes 2 s at most. One that hangs is not gone,
        and neither is one that the master does not know.

        Returns why the dispatch stays, as part of a sentence; empty when it is being cancelled.
        """
        with self._lock:
            client, goal, gone, number = self._client, self._goal, self._gone, self._dispatches
        if not gone:
            if not client:
                return "for a client that is not known"
            try:
                leased = goal and self._watch.state(goal) is not LeaseState.LOST
                if leased or living_namesake(client, master_link.bounded_master()) is not None:
                    return f"for {client}"
            except master_link.ERRORS:
                return f"for {client}"
            with self._lock:
                if self._client is None:
                    return ""  # it has ended meanwhile
                if self._dispatches != number:
                    return f"for {self._client or 'a client that is not known'}"
                self._gone = f"its owner {client} is gone"
        self._act()
        return ""

    def shutdown(self) -> None:
        """Watches no more."""
        self._watch.shutdown()

    def _held(self, client: Optional[str]) -> List[str]:
        """Goals that a client holds and that no earlier dispatch had; called with the lock held."""
        held = self._watch.goals_of(client) if client else []
        return [goal for goal in held if goal not in self._earlier]

    def _lease_changed(self, change: LeaseChange) -> None:
        with self._lock:
            if (
                self._client
                and not self._goal
                and change.state is not LeaseState.LOST
                and change.goal not in self._earlier
                and self._watch.owner(change.goal) == self._client
            ):
                self._goal = change.goal
            mine = self._client is not None and change.goal == self._goal
        if mine:
            self.changed(change.state, change.reason)

    def _act(self) -> None:
        """Suspends, resumes or cancels the dispatch by the state of its owner."""
        with self._lock:
            dispatch, key, silent, gone = self._dispatch, self._key, self._silent, self._gone
        if dispatch is None:
            return
        dispatch.suspend(bool(silent))
        if silent:
            rospy.logwarn("%s: no further action starts: %s", self._scope, silent)
            ownership.suspend(key, silent)
        else:
            ownership.resume(key)
        if gone:
            dispatch.cancel(gone)
        if dispatch.ended.is_set():  # meanwhile, and nothing else would resume it
            ownership.resume(key)
