# SPDX-License-Identifier: Apache-2.0
"""Whether the base may move: events in, decisions out. Knows nothing of ROS and starts no thread."""

from enum import Enum, IntEnum
from typing import Collection, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from merlin_guard.attention_clock import AttentionClock
from merlin_guard.lease_book import BaseOwnership
from merlin_guard.motion_server import GoalReport, MotionGoal, MotionServer
from merlin_guard.settings import GuardSettings

REPEAT_CANCEL = 0.5  # s between two cancels of a goal whose motion is refused for good

LEASED = "-leased"  # ends the id of a goal that its client leases (merlin_msgs/Lease)
NO_GOAL = "no motion goal is active"


class Send(Enum):
    """What goes to the base because of an event."""

    NOTHING = "nothing"
    COMMAND = "command"
    """The velocity that just came."""
    ZERO = "zero"


class GuardState(IntEnum):
    """What the guard does; the numbers are those of merlin_msgs/GuardStatus."""

    IDLE = 0
    PASSING = 1
    HOLDING = 2
    STOPPED = 3


class PermitVerdict(NamedTuple):
    """A state and its reason, one sentence."""

    state: GuardState
    reason: str


class GoalCancel(NamedTuple):
    """A goal that the guard asks its server to stop."""

    server: str
    goal_id: str
    reason: str
    first: bool
    """Whether it is asked for the first time."""


class PermitDecision(NamedTuple):
    """What has to happen because of an event."""

    send: Send
    cancels: Tuple[GoalCancel, ...]


class View(NamedTuple):
    """What is published; a view that equals the last one is not published again."""

    state: GuardState
    reason: str
    moving: bool
    goals: Tuple[str, ...]
    cancelled: Tuple[str, ...]
    heard: Tuple[str, ...]
    """The motion servers whose status is heard."""


class MotionPermit:
    """Decides for each velocity whether it reaches the base.

    A velocity passes while at least one goal of a motion server is active, and none of the active ones must
    not move the base: a velocity does not say which goal it belongs to. A zero velocity always passes.

    Each event takes `now`, s of the monotonic clock, and returns what has to happen. Not thread-safe.

    :param servers: resolved names of the actions that move the base.
    :param settings: limits.
    :param stopped: why the base is stopped from the beginning; empty: it is not.
    """

    def __init__(
        self, servers: Sequence[str], settings: Optional[GuardSettings] = None, stopped: str = ""
    ) -> None:
        self.settings = settings or GuardSettings()
        self._clock = AttentionClock()
        self._servers = {name: MotionServer(name, self.settings, self._clock) for name in servers}
        self._stopped = stopped
        self._moving = False
        self._commanded_at: Optional[float] = None  # world clock of the last velocity that passed
        self._verdict = self._judge()

    @property
    def view(self) -> View:
        """The state after the last event."""
        active = [goal for server in self._servers.values() for goal in server.active_goals()]
        goals = tuple(goal.id for goal in active)
        cancelled = tuple(goal.id for goal in active if goal.cancelled_at is not None)
        state, reason = self._verdict
        if state is GuardState.PASSING and self._commanded_at is None:
            reason = "a motion goal may move the base, but no command comes"
        heard = tuple(name for name, server in self._servers.items() if not server.why_not_heard())
        return View(state, reason, self._moving, goals, cancelled, heard)

    @property
    def drivers(self) -> Tuple[str, ...]:
        """The motion servers whose goals may move the base now."""
        if self._verdict.state is not GuardState.PASSING:
            return ()
        return tuple(name for name, server in self._servers.items() if server.active_goals())

    @property
    def world(self) -> float:
        """s of the robot's world that the guard has paid attention to."""
        return self._clock.world

    def status(self, server: str, reports: Iterable[GoalReport], now: float) -> PermitDecision:
        """A motion server has published its status list."""
        self._clock.advance(now)
        self._servers[server].report(reports)
        return self._settle()

    def goal_sent(self, server: str, goal_id: str, stamp: int, now: float) -> PermitDecision:
        """A client has sent a goal, at `stamp` (ns of ROS time)."""
        self._clock.advance(now)
        self._servers[server].goal_sent(goal_id, stamp)
        return self._settle()

    def cancel(self, server: str, goal_id: str, stamp: int, now: float) -> PermitDecision:
        """A client has sent a cancel; `goal_id` and `stamp` as in actionlib."""
        self._clock.advance(now)
        self._servers[server].cancel(goal_id, stamp)
        return self._settle()

    def ros_time(self, ros_time: int, now: float) -> None:
        """What ROS time is, ns; to be called before each event that has a stamp, and each tick."""
        self._clock.advance(now)
        self._clock.look(ros_time)

    def lease(
        self, server: str, owner: str, life: str, held: Sequence[str], suspended: Sequence[str], now: float
    ) -> PermitDecision:
        """A client of a motion server has published its lease."""
        self._clock.advance(now)
        self._servers[server].leases.receive(owner, life, held, suspended, self._clock.wall)
        return self._settle()

    def command(self, moving: bool, now: float) -> PermitDecision:
        """A velocity has come.

        :param moving: whether it is not zero.
        """
        self._clock.advance(now)
        settled = self._settle()
        passes = self._verdict.state is GuardState.PASSING
        self._moving = moving and passes
        self._commanded_at = self._clock.world if passes else None
        return settled._replace(send=Send.COMMAND if passes or not moving else Send.ZERO)

    def stop(self, reason: str, now: float) -> PermitDecision:
        """Stops the base until :meth:`release`, and cancels the goals that run or come until then."""
        self._clock.advance(now)
        self._stopped = self._stopped or reason
        return self._settle()._replace(send=Send.ZERO)

    def release(self, now: float) -> PermitDecision:
        """Ends a stop; goals that were cancelled by it stay cancelled."""
        self._clock.advance(now)
        self._stopped = ""
        return self._settle()

    def halt(self, reason: str, now: float) -> PermitDecision:
        """Refuses the motion of all goals there are, for good, and cancels them; newer ones may move."""
        self._clock.advance(now)
        self._refuse_all(reason)
        return self._settle()._replace(send=Send.ZERO)

    def brake(self, reason: str, now: float) -> PermitDecision:
        """Holds the base for leased goals that are about to be cancelled; newer and foreign ones may move.

        Which ones is not known here: a goal without a cancel may move again after the brake's limit.
        """
        self._clock.advance(now)
        for server, goal in self._goals():
            if goal.id.endswith(LEASED) or server.claim(goal).ownership is not BaseOwnership.FOREIGN:
                goal.brake(reason, self._clock.wall)
        return self._settle()

    def world_rate(self, rate: float, now: float) -> PermitDecision:
        """A simulator says how fast it runs, s per s of wall time; 0: it is paused."""
        self._clock.advance(now)
        self._clock.set_rate(rate)
        return self._settle()

    def tick(
        self, now: float, clients: Optional[Mapping[str, Collection[str]]] = None, simulated: bool = True
    ) -> PermitDecision:
        """Time has passed; to be called several times per second.

        :param clients: by motion server the nodes whose lease connection is open; None: not known.
        :param simulated: whether a simulator is connected: one that is gone does not pause or slow the world.
        """
        self._clock.advance(now)
        if not simulated:
            self._clock.set_rate(1.0)
        for name, server in self._servers.items():
            if clients is not None:
                server.leases.connected(clients[name])
        return self._settle()

    def _settle(self) -> PermitDecision:
        """Judges anew what holds now; the base stops when it may move no longer."""
        if self._stopped:
            self._refuse_all(self._stopped)
        for server, goal in self._goals():
            reason = self._lost(server, goal)
            if reason:
                goal.refuse(reason)
        self._verdict = self._judge()
        if self._verdict.state is not GuardState.PASSING or self._command_is_old():
            self._commanded_at = None
        send = Send.NOTHING
        if self._moving and self._commanded_at is None:
            self._moving = False
            send = Send.ZERO
        return PermitDecision(send, tuple(self._due_cancels()))

    def _command_is_old(self) -> bool:
        at = self._commanded_at
        return at is not None and self._clock.world - at > self.settings.command_timeout

    def _judge(self) -> PermitVerdict:
        if self._stopped:
            return PermitVerdict(GuardState.STOPPED, self._stopped)
        active = [(server, goal) for server in self._servers.values() for goal in server.active_goals()]
        if not active:
            return PermitVerdict(GuardState.IDLE, NO_GOAL)
        refused = [(server, goal.refused) for server, goal in active if goal.refused]
        for server, reason in refused or [
            (server, self._why_not_now(server, goal)) for server, goal in active
        ]:
            if reason:
                return PermitVerdict(
                    GuardState.HOLDING, f"a goal of {server.name} must not move the base: {reason}"
                )
        return PermitVerdict(GuardState.PASSING, f"{active[0][0].name} drives")

    def _why_not_now(self, server: MotionServer, goal: MotionGoal) -> str:
        """Why an active goal must not move the base at the moment; empty when it may."""
        reason = goal.why_braked(self._clock.wall, self.settings.brake_limit) or server.why_not_heard()
        if reason:
            return reason
        claim = server.claim(goal)
        if claim.ownership is BaseOwnership.FOREIGN:
            return self._why_lease_needed(goal)
        if claim.ownership is not BaseOwnership.HELD:
            return claim.reason
        if claim.heard_at < self._clock.back_at:
            return "the guard was held up and has not heard its owner since"
        return ""

    def _lost(self, server: MotionServer, goal: MotionGoal) -> str:
        """Why a goal must never move the base again; empty: it may."""
        if goal.refused:
            return goal.refused
        now = self._clock.wall
        if goal.cancelled_at is not None and now - goal.cancelled_at > self.settings.cancel_deadline:
            return f"it was cancelled and still runs {self.settings.cancel_deadline:g} s later"
        claim = server.claim(goal)
        if claim.ownership is BaseOwnership.LOST:
            return claim.reason
        if claim.ownership is BaseOwnership.FOREIGN and now - goal.seen_at > self.settings.lose_after:
            return self._why_lease_needed(goal)
        return ""

    def _why_lease_needed(self, goal: MotionGoal) -> str:
        if goal.earlier:
            return "it ran before the guard began, and no lease names it"
        if goal.id.endswith(LEASED) and self._clock.wall - goal.seen_at > self.settings.suspend_after:
            return "its client leases it, and no lease names it"
        return "no lease names it (require_lease)" if self.settings.require_lease else ""

    def _refuse_all(self, reason: str) -> None:
        for server in self._servers.values():
            server.refuse_all(reason)

    def _due_cancels(self) -> List[GoalCancel]:
        now = self._clock.wall
        due = []
        for server, goal in self._goals():
            first = goal.asked_at is None
            again = goal.asked_at is None or now - goal.asked_at >= REPEAT_CANCEL
            if goal.refused and again and not server.gone:
                goal.asked_at = now
                goal.mark_cancelled(now)
                due.append(GoalCancel(server.name, goal.id, goal.refused, first))
        return due

    def _goals(self) -> List[Tuple[MotionServer, MotionGoal]]:
        return [(server, goal) for server in self._servers.values() for goal in server.goals.values()]
