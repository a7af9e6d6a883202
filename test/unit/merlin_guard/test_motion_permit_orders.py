# SPDX-License-Identifier: Apache-2.0
"""The guard's decisions in random orders of events."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from merlin_guard.motion_permit import GuardState, MotionPermit, Send
from merlin_guard.motion_server import ACTIVE, PREEMPTING, GoalReport

BASE, DOCK = "/move_base", "/dock"
SUCCEEDED, PREEMPTED = 3, 2


class RandomOrders(RuleBasedStateMachine):
    """Any order of events; what the base gets is checked against what was said last."""

    ids = st.sampled_from("abc")
    owners = st.sampled_from(("/x", "/y"))

    def __init__(self):
        super().__init__()
        self.permit = MotionPermit([BASE, DOCK])
        self.now = 0.0
        self.listed = {BASE: {}, DOCK: {}}  # last status lists
        self.leases = {}  # (server, owner) → last lease and its time
        self.lives = {}  # (server, owner) → its lives, the present one last
        self.halted = set()
        self.braked = {}  # (server, goal) → when, by the clock below
        self.clock = 0.0  # what the guard counts
        self.stopped = False
        self.moving = False
        self.fresh = 0  # goals that no other one shares its id with

    def note(self, decision, command=None):
        if decision.send is Send.COMMAND:
            self.moving = bool(command)
            if command:
                self.check_allowed()
        elif decision.send is Send.ZERO:
            self.moving = False

    def check_allowed(self):
        assert not self.stopped
        active = {
            (server, goal_id)
            for server, goals in self.listed.items()
            for goal_id, status in goals.items()
            if status in (ACTIVE, PREEMPTING)
        }
        assert active
        assert not active & self.halted
        assert all(self.clock - self.braked.get(goal, -10.0) > 2.0 - 1e-6 for goal in active)
        for server, goal_id in active:
            naming = [
                (life_at, goal_id in held and goal_id not in suspended)
                for (where, _), (held, suspended, life_at) in self.leases.items()
                if where == server and goal_id in held | suspended
            ]
            if naming:  # owned: at least one owner holds it and spoke lately
                assert any(good and self.now - at <= 0.6 + 1e-9 for at, good in naming)

    @rule(
        server=st.sampled_from((BASE, DOCK)), goals=st.dictionaries(ids, st.sampled_from((0, 1, 2, 3, 6, 7)))
    )
    def status(self, server, goals):
        for goal_id in set(self.listed[server]) | set("abc"):
            if goals.get(goal_id, 3) not in (0, 1, 6, 7):
                self.halted.discard((server, goal_id))
                self.braked.pop((server, goal_id), None)
        self.listed[server] = goals
        reports = [GoalReport(goal_id, status) for goal_id, status in goals.items()]
        self.note(self.permit.status(server, reports, self.now))

    @rule(
        server=st.sampled_from((BASE, DOCK)),
        owner=owners,
        life=st.sampled_from("12"),
        held=st.sets(ids),
        suspended=st.sets(ids),
    )
    def lease(self, server, owner, life, held, suspended):
        lives = self.lives.setdefault((server, owner), [life])
        if life not in lives[:-1]:  # else a late word of a life that is over, which says nothing
            self.lives[server, owner] = [*lives, life] if life != lives[-1] else lives
            self.leases[server, owner] = held, suspended, self.now
        self.note(self.permit.lease(server, owner, life, list(held), list(suspended), self.now))

    @rule(server=st.sampled_from((BASE, DOCK)), goal_id=st.sampled_from(("", "a", "b", "c")))
    def cancel(self, server, goal_id):
        self.note(self.permit.cancel(server, goal_id, 0.0, self.now))

    @rule(server=st.sampled_from((BASE, DOCK)), goal_id=ids)
    def goal_sent(self, server, goal_id):
        self.note(self.permit.goal_sent(server, goal_id, 0, self.now))

    @rule(moving=st.booleans())
    def command(self, moving):
        self.note(self.permit.command(moving, self.now), moving)

    @rule()
    def stop(self):
        self.stopped = True
        self.note(self.permit.stop("by hand", self.now))

    @rule()
    def release(self):
        self.stopped = False
        self.note(self.permit.release(self.now))

    @rule()
    def halt(self):
        for server, goals in self.listed.items():
            self.halted |= {(server, goal_id) for goal_id, status in goals.items() if status in (0, 1, 6, 7)}
        self.note(self.permit.halt("halted", self.now))

    @rule()
    def brake(self):
        for (server, _), (held, suspended, _) in self.leases.items():
            live = {goal_id for goal_id, status in self.listed[server].items() if status in (0, 1, 6, 7)}
            self.braked.update({(server, goal_id): self.clock for goal_id in live & (held | suspended)})
        self.note(self.permit.brake("braked", self.now))

    @rule(seconds=st.floats(0.0, 0.15))
    def short_time(self, seconds):
        self.now += seconds
        self.clock += seconds
        self.note(self.permit.tick(self.now))

    @rule(seconds=st.floats(0.15, 30.0))
    def long_time(self, seconds):
        self.now += seconds
        self.clock += min(seconds, 0.2)
        for key, (held, suspended, at) in self.leases.items():  # what the guard missed it does not count
            self.leases[key] = held, suspended, max(at, at + seconds - 0.2)
        self.note(self.permit.tick(self.now))

    @rule()
    def servers_count_as_dead(self):
        for _ in range(80):
            self.now += 0.2
            self.clock += 0.2
            self.note(self.permit.tick(self.now))

    @precondition(lambda self: self.stopped)
    @rule()
    def nothing_passes_while_stopped(self):
        assert self.permit.command(True, self.now).send is Send.ZERO

    @invariant()
    def what_moves_is_permitted(self):
        view = self.permit.view
        assert view.moving == self.moving
        if self.moving:
            assert view.state is GuardState.PASSING
            self.check_allowed()
        if self.stopped:
            assert view.state is GuardState.STOPPED

    @rule()
    def all_is_well_again(self):
        """Whatever happened: once all goals have ended and a new, owned one is active, it drives."""
        self.release()
        self.status(BASE, {})
        self.status(DOCK, {})
        self.fresh += 1
        fresh = f"fresh {self.fresh}"
        self.lease(BASE, "/z", "1", {fresh}, set())
        self.status(BASE, {fresh: ACTIVE})
        decision = self.permit.command(True, self.now)
        assert decision.send is Send.COMMAND and not decision.cancels
        self.moving = True
        self.status(BASE, {})


RandomOrders.TestCase.settings = settings(max_examples=300, stateful_step_count=30)
TestRandomOrders = RandomOrders.TestCase
