# SPDX-License-Identifier: Apache-2.0
"""The owner of the running dispatch; a silent owner suspends the dispatch, one that is gone loses it.

The action server watches the owner of a goal of ``dispatch_plan_action``. A caller of the service has no id
that it could lease: its dispatch runs to its end, until another client wants the dispatcher and the caller
turns out to be dead. So does the dispatch of a goal whose client leases nothing.
"""

import threading
from typing import TYPE_CHECKING, Optional

import rospy

from merlin_ros.actions.lease import LEASED, LeaseState
from merlin_ros.actions.ownership import ownership
from merlin_ros.master import master_link
from merlin_ros.master.namesake import living_namesake

if TYPE_CHECKING:  # imported when there is a plan
    from merlin_rosplan.dispatch.dispatch import PlanDispatch


class DispatchOwner:
    """The owner of one dispatch after the other; thread-safe.

    While it is silent no further action starts, and the running ones are suspended; when it is gone the
    dispatch is cancelled.

    :param scope: global name of the dispatcher.
    """

    def __init__(self, scope: str) -> None:
        self._scope = scope
        self._lock = threading.Lock()  # guards the fields below
        self._client: Optional[str] = None
        self._dispatches = 0  # begun so far
        self._goal = ""
        self._silent = ""  # why it may not be there
        self._gone = ""  # why it is gone
        self._dispatch: Optional[PlanDispatch] = None
        self._key = ""

    def begin(self, client: str, goal: str = "") -> None:
        """A dispatch begins.

        :param client: the node that asked for it; empty: not known.
        :param goal: id of its goal; empty: it called the service.
        """
        with self._lock:
            self._client, self._goal, self._dispatch = client, goal, None
            self._dispatches += 1
            self._silent = self._gone = ""

    def attach(self, dispatch: "PlanDispatch", key: str) -> None:
        """The dispatch that it owns is about to run.

        :param key: names it in :data:`merlin_ros.actions.ownership.ownership`, which suspends its actions.
        """
        with self._lock:
            self._dispatch, self._key = dispatch, key
        self._act()

    def end(self) -> None:
        """The dispatch has ended, or did not come to run."""
        with self._lock:
            key = self._key
            self._client, self._dispatch, self._goal, self._key = None, None, "", ""
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
                if goal.endswith(LEASED) or living_namesake(client, master_link.bounded_master()) is not None:
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
