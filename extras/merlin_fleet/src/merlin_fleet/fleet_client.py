# SPDX-License-Identifier: Apache-2.0
"""FleetClient: sends goals to a fleet and takes them back, from any machine, without ROS."""

import contextlib
import threading
import time
import traceback
import uuid
from typing import Any, Callable, Dict, Iterable, List, Optional, Sequence, Tuple, Union

from merlin_fleet.certified import HubError, Tls
from merlin_fleet.core import records
from merlin_fleet.core.clock import CLOCK_MARGIN, difference
from merlin_fleet.core.possession import CANCELLED
from merlin_fleet.core.records import Goal, Halt, Keys, Profile, RecordError, Report, Status
from merlin_fleet.core.retention import Keeper, removal
from merlin_fleet.core.store import Change, Compare, Put, Snapshot, Txn, TxnResult
from merlin_fleet.core.view import FleetGoalState, FleetView
from merlin_fleet.etcd_messages import HubRefuses
from merlin_fleet.fleet_request import FleetRequest, GoalNews, own_name
from merlin_fleet.forgetting import Leavings, leavings
from merlin_fleet.goal_refusals import check_goal, refused, unsuited_all
from merlin_fleet.hub import DEFAULT_ENDPOINT, EtcdHub
from merlin_fleet.hub_watch import Listener
from merlin_fleet.prospects import hopeless, remarks

DEFAULT_FLEET = "fleet"
#: Outcomes of a goal that holds.
ACHIEVED = ("SUCCEEDED", "ALREADY_TRUE")
LIMIT = 10.0  # s for the hub to take a goal or a cancel
PULSE = 0.7  # s between two checks that the hub answers; it has 2 s for an answer
STOPS = 2.0  # s for a robot to confirm a stop; the page waits 3 s
PAUSE = 0.3  # s between attempts
WORDS = (records.ROBOTS, records.STATUS)  # what robots say of themselves all the time
OVER = (FleetGoalState.ENDED, FleetGoalState.CANCELLED)


class FleetError(Exception):
    """What was asked of the fleet cannot be done; the text says why."""


class FleetClient(Listener):
    """Talks to a fleet. Thread-safe.

    :param fleet: its name.
    :param endpoints: host:port of each member of its etcd.
    :param tls: None: without certificates, and then only on this machine.
    :param on_change: called after each change of fleet and connection, in another thread; must not block.
    :raises FleetError: for a name, an address or certificates that cannot be used.
    """

    def __init__(
        self,
        fleet: str = DEFAULT_FLEET,
        endpoints: Sequence[str] = (DEFAULT_ENDPOINT,),
        tls: Optional[Tls] = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.fleet = fleet
        self._on_change = on_change
        self._changed = threading.Condition()  # guards the fields below
        self._said = "the hub has not answered yet"
        self._unusable = ""  # what no waiting mends
        self._heard = 0.0
        self._stores = 0
        self._words: Dict[str, Tuple[float, float]] = {}  # robot → time of its last word, by it and by us
        self._requests: List[Tuple[FleetRequest, Optional[Callable[[FleetRequest], None]]]] = []
        try:
            self._keys = Keys(fleet)
            self._view = FleetView(self._keys)
            self._hub = EtcdHub(self._keys.root, endpoints, tls, end=self._keys.clients_end)
        except (RecordError, HubError) as error:
            raise FleetError(str(error)) from None
        self._sender = own_name()
        self._hub.follow(self)
        self._closed = threading.Event()
        threading.Thread(target=self._pulse, name="fleet pulse", daemon=True).start()

    # --- as MerlinExecutorClient has it

    def wait_for_hub(self, timeout: Optional[float] = None) -> bool:
        """Waits until the hub answers, s; None: as long as it takes.

        :return: whether it can be used.
        """
        self.wait(lambda: not self._said or self._unusable, timeout)
        return not self.missing

    @property
    def missing(self) -> str:
        """Why the hub cannot be used; empty: it can."""
        with self._changed:
            return self._unusable or self._said

    @property
    def heard(self) -> float:
        """The last contact with the hub, s since 1970: the known state is of that time. 0: never."""
        with self._changed:
            return self._heard

    def listen(self, on_change: Callable[[], None]) -> None:
        """Replaces what is called after each change; it must not block."""
        self._on_change = on_change

    def send(
        self,
        goals: Union[str, Sequence[str]],
        value: float = 0.0,
        begin_by: Optional[float] = None,
        on_done: Optional[Callable[[FleetRequest], None]] = None,
        sender: str = "",
        **more: Any,
    ) -> FleetRequest:
        """Sends goals, as PDDL text; returns when the hub has them on its disk.

        :param value: goals of a greater one are taken and begun first.
        :param begin_by: s from now; a goal that is not begun by then ends as MISSED.
        :param on_done: called once with the ended request, in another thread; must not block.
        :param sender: the sender, beside this machine and its user.
        :param more: `robot`, `groups`, `needs`, `domain`, `finish` and `tries` of
            :class:`merlin_fleet.core.records.Goal`.
        :raises FleetError: for what is not a goal, for a robot that there is not, for a goal that no robot's
            domain and objects allow, for `begin_by` by a clock that is far from the hub's, and when the hub
            did not take it.
        """
        texts = (goals,) if isinstance(goals, str) else tuple(goals)
        if begin_by is not None:
            self._check_clock()
        now, name = time.time(), uuid.uuid4().hex[:8]
        deadline = None if begin_by is None else now + begin_by
        goal = Goal(name, texts, now, self._named(sender), value=value, deadline=deadline, **more)
        try:
            check_goal(goal)
        except ValueError as error:
            raise FleetError(str(error)) from None
        end = self._reach(time.monotonic() + LIMIT)
        self.check(goal)
        request = FleetRequest(self, goal.id)
        with self._changed:
            self._requests.append((request, on_done))
        try:
            key = self._keys.key(records.GOALS, goal.id)
            request.taken(
                self._write(key, records.encode(goal), "another goal of this id is there already", end)
            )
        except FleetError:
            with self._changed:
                self._requests = [each for each in self._requests if each[0] is not request]
            raise
        return request

    def check(self, goal: Goal) -> None:
        """Checks that a robot of the fleet knows what a goal is about.

        :raises FleetError: when there is no such robot, or each that may take the goal refuses it.
        """
        with self._changed:
            robots, schemas = dict(self._view.robots), dict(self._view.schemas)
        reason = refused(goal, robots, schemas)
        if reason:
            raise FleetError(reason)

    def prospect(self, goal: Goal) -> str:
        """A sentence for the sender of a goal that no robot can take at present; empty: one can."""
        with self._changed:
            return unsuited_all(goal, self._view.robots)

    def stop(self, robot: str, sender: str = "") -> Tuple[bool, str]:
        """Has a robot stop, and hold its base until it is released there; waits for its answer.

        :param sender: the person who asks for it, beside this machine and its user.
        :return: whether the robot has confirmed that its guard holds the base; how it is held, or why that is
            not known. A robot that is not reached stops when it is.
        :raises FleetError: when there is no such robot, or the hub did not take it.
        """
        with self._changed:
            if robot not in self._view.robots:
                raise FleetError("there is no such robot in the fleet")
        text = records.encode(Halt(self._named(sender), time.time()))
        try:
            revision = self._hub.transact(
                Txn(puts=(Put(self._keys.key(records.HALTS, robot), text),))
            ).revision
        except HubError as error:
            raise FleetError(f"the hub has not confirmed it: {error}") from None
        answered = self.wait(lambda: self.status(robot)[0].stop >= revision, STOPS)
        hold = self.status(robot)[0].hold
        if answered:
            return bool(hold), hold or "its guard has not confirmed it"
        with self._changed:
            joined = robot in self._view.lives
        return False, "it has not answered yet" if joined else "it is not joined, and stops when it is back"

    def status(self, robot: str) -> Tuple[Status, Optional[Halt]]:
        """What a robot says of itself, and the stop that it has not carried out yet."""
        with self._changed:
            return self._view.status.get(robot, Status()), self._view.halts.get(robot)

    def spoke(self, robot: str) -> float:
        """When its status came, or its profile where it has none, s since 1970 by this machine's clock.

        What was there before this client is as old as the robot says, and not of a later time. 0: nothing is.
        """
        with self._changed:
            return self._words.get(robot, (0.0, 0.0))[1]

    def execute(
        self, goals: Union[str, Sequence[str]], timeout: Optional[float] = None, **options: Any
    ) -> Report:
        """Sends goals and waits for the end; a time-out cancels them and waits for that.

        :param timeout: s; None: as long as it takes.
        """
        request = self.send(goals, **options)
        if not request.wait(timeout):
            request.cancel()
            request.wait()
        report = request.result
        assert report is not None
        return report

    def cancel_all(self) -> None:
        """Cancels every goal that this client has sent and that has not ended."""
        with self._changed:
            requests = [request for request, _ in self._requests]
        for request in requests:
            request.cancel()

    def close(self) -> None:
        """Ends the connection; goals continue."""
        self._closed.set()
        self._hub.close()

    # --- goals of others

    def request(self, goal: str) -> FleetRequest:
        """A goal that is in the fleet, of any sender.

        :raises FleetError: when no goal has this id.
        """
        with self._changed:
            written = self._view.written.get(goal)
        if written is None:
            raise FleetError(f"there is no goal '{goal}' in the fleet '{self.fleet}'")
        return FleetRequest(self, goal, written)

    def cancel(self, goal: str, sender: str = "") -> None:
        """Cancels a goal; one that has ended stays as it is.

        :param sender: the client that cancels it, beside this machine and its user.
        :raises FleetError: when no goal has this id, or the hub did not take the cancel.
        """
        with self._changed:
            known = any(request.id == goal for request, _ in self._requests)
        if not known:
            self.request(goal)
        news = self.news(goal)
        if news is not None and (news.state in OVER or news.state is FleetGoalState.CANCELLING):
            return
        self._write(
            self._keys.key(records.CANCELS, goal),
            records.encode_cancel(self._named(sender), time.time()),
            "",
            time.monotonic() + LIMIT,
        )

    def remove_ended(self, keeper: Keeper) -> int:
        """Removes goals that are no longer to be kept; returns how many.

        :raises FleetError: when the hub does not allow it.
        """
        with self._changed:
            due = keeper.due(self._view, time.monotonic(), time.time()) if not self._said else []
            removals = [removal(self._keys, self._view, goal) for goal in due]
        removed = 0
        for txn in removals:
            try:
                removed += self._hub.transact(txn).done
            except HubRefuses as error:
                raise FleetError(str(error)) from None
            except HubError:
                break  # the next look finds the rest
        return removed

    def leavings(self, robot: str) -> Leavings:
        """What a robot that never comes back has left in the fleet."""
        with self._changed:
            return leavings(self._keys, self._view, robot)

    def forget(self, left: Leavings) -> None:
        """Removes what a robot has left: its goals to finish are open again.

        :raises FleetError: when it is in the fleet, or the hub does not allow it or does not answer.
        """
        for txn in left.removal(self._keys):
            try:
                if not self._hub.transact(txn).done:
                    raise FleetError(f"'{left.robot}' or its goals have reported meanwhile; look again")
            except HubError as error:
                hint = "; use root's" if isinstance(error, HubRefuses) else "; repeat it"
                raise FleetError(f"{error}{hint}") from None

    def news(self, goal: str) -> Optional[GoalNews]:
        """What the fleet says of a goal; None: nothing."""
        with self._changed:
            known = self._view.goals.get(goal)
            return self._news(known) if known is not None else None

    @property
    def revision(self) -> int:
        """Of the hub; what is known is of it, or later."""
        with self._changed:
            return self._view.revision

    @property
    def stores(self) -> int:
        """How often the hub was another one than before, or one of before: what it had then may be gone."""
        with self._changed:
            return self._stores

    def goals(self, remarked: Optional[int] = None) -> List[GoalNews]:
        """All goals, the oldest first.

        :param remarked: of so many open goals it is looked why they are open, which takes long in a large
            fleet; None: of all.
        """
        found: List[GoalNews] = []
        left = len(self._view.goals) if remarked is None else remarked
        with self._changed:
            for goal in sorted(self._view.goals.values(), key=lambda it: it.sent):
                found.append(self._news(goal, left > 0))
                left -= found[-1].state is FleetGoalState.OPEN
        return found

    def robots(self) -> List[Tuple[records.Profile, bool]]:
        """All robots that were ever joined, and whether they are now."""
        with self._changed:
            return [(robot, name in self._view.lives) for name, robot in sorted(self._view.robots.items())]

    def facts(self) -> List[Tuple[records.Facts, bool]]:
        """What robots share, and whether each still vouches for it: it is as old as its last sign of life."""
        with self._changed:
            lives = {name: life.life for name, life in self._view.lives.items()}
            known = sorted(self._view.facts.items())
            return [(facts, lives.get(robot) == facts.life) for (robot, _), facts in known]

    def wait(self, holds: Callable[[], Any], timeout: Optional[float] = None) -> bool:
        """Waits until a condition holds of the hub's keys.

        :param timeout: s; None: as long as it takes.
        """
        with self._changed:
            return bool(self._changed.wait_for(holds, timeout))

    def _check_clock(self) -> None:
        """Compares the clock of this machine with the hub's, where the hub tells its time.

        :raises FleetError: when it is so wrong that robots would take a time of it for another one.
        """
        with contextlib.suppress(HubError):
            off = time.time() - self._hub.time()
            if abs(off) > CLOCK_MARGIN:
                raise FleetError(
                    f"the clock of this machine is {difference(off)}: no time to begin by can be given"
                )

    def _named(self, sender: str) -> str:
        return f"{sender} ({self._sender})" if sender else self._sender

    def _news(self, goal: Goal, remarked: bool = True) -> GoalNews:
        view, state = self._view, self._view.state(goal.id)
        claim, report = view.claims.get(goal.id), view.ends.get(goal.id)
        if state is FleetGoalState.CANCELLED:
            report = Report(goal.id, "", 0, CANCELLED, "no robot has it", 0.0)
        if state is not FleetGoalState.OPEN or not remarked:
            return GoalNews(goal, state, claim.robot if claim else "", {}, report)
        return GoalNews(goal, state, "", remarks(view, goal), report, hopeless(view, goal))

    def _reach(self, end: float) -> float:
        """Waits until the hub answers, at most until a moment; returns that.

        :raises FleetError: when it does not, or cannot be used.
        """
        if not self.wait_for_hub(max(0.0, end - time.monotonic())):
            if self._unusable:
                raise FleetError(self._unusable)
            raise FleetError(f"the hub did not take it within {LIMIT:g} s: {self.missing}")
        return end

    def _write(self, key: str, text: str, taken: str, end: float) -> int:
        """Writes a key once; an attempt whose answer was lost may have done it.

        :param taken: what is wrong when the key has another text; empty: nothing.
        :param end: s of ``time.monotonic`` from which on it is not tried again.
        :return: a revision at which the key existed.
        """
        txn = Txn((Compare(key, 0),), (Put(key, text),), (), (key,))
        while True:
            self._reach(end)
            try:
                answer: TxnResult = self._hub.transact(txn)
            except HubRefuses as error:
                raise FleetError(str(error)) from None
            except HubError as error:
                if time.monotonic() >= end:
                    raise FleetError(f"whether the hub has taken it is not known: {error}") from None
                time.sleep(PAUSE)  # no event says that the hub works again
                continue
            if answer.done or not taken or any(item.value == text for item in answer.items):
                return answer.revision
            raise FleetError(f"{taken}; send it again")

    # --- changes of the hub

    def on_connected(self, snapshot: Snapshot) -> None:
        """All keys were read."""
        view = FleetView.of(self._keys, snapshot)
        with self._changed:
            self._stores += snapshot.another or not view.follows(self._view)
            self._view = view
            self._heard = time.time()
            self._note_words(view.robots, all_came_now=False)
            about = self._view.unreadable.get(self._keys.key(records.ABOUT), "")
            self._unusable = f"the fleet '{self.fleet}' of this hub cannot be used: {about}" if about else ""
            self._said = ""
        self._tell()

    def on_resumed(self) -> None:
        """The hub calls it when changes arrive again after a loss."""
        with self._changed:
            self._said, self._heard = "", time.time()
        self._tell()

    def on_changed(self, changes: Tuple[Change, ...]) -> None:
        """The hub calls it with keys that have changed."""
        with self._changed:
            self._view.apply(changes)
            self._heard = time.time()
            said = (self._keys.parts(change.key) for change in changes)
            self._note_words(parts[1] for parts in said if parts and parts[0] in WORDS and len(parts) == 2)
        self._tell()

    def on_disconnected(self, reason: str) -> None:
        """The hub calls it when it loses its connection, with the reason."""
        with self._changed:
            self._said = reason
        self._tell()

    def _note_words(self, robots: Iterable[str], all_came_now: bool = True) -> None:
        view, now = self._view, time.time()
        for robot in robots:
            at = view.status.get(robot, Status()).at or view.robots.get(robot, Profile("")).heard
            before = self._words.get(robot)
            if before is None or before[0] != at:
                came_now = all_came_now or before is not None
                self._words[robot] = (at, now if came_now else min(at, now))

    def _pulse(self) -> None:
        while not self._closed.wait(PULSE):
            with self._changed:
                connected = not self._said
            if connected:
                with contextlib.suppress(HubError):  # it calls `on_disconnected` itself
                    self._hub.check()
                    with self._changed:
                        self._heard = time.time()

    def _tell(self) -> None:
        with self._changed:
            self._changed.notify_all()
            ended = [each for each in self._requests if each[0].done]
            self._requests = [each for each in self._requests if each not in ended]
        for request, on_done in ended:
            if on_done is not None:
                _call_back(on_done, request)
        _call_back(self._on_change)


def _call_back(callback: Callable[..., None], *arguments: Any) -> None:
    try:
        callback(*arguments)
    except Exception:  # an application's mistake does not end the thread that hears of all other goals
        traceback.print_exc()
