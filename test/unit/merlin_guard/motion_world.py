# SPDX-License-Identifier: Apache-2.0
"""A guard whose clock and peers a test moves."""

from merlin_guard.motion_permit import MotionPermit, Send
from merlin_guard.motion_server import ACTIVE, GoalReport
from merlin_guard.settings import GuardSettings

BASE, DOCK = "/move_base", "/dock"


class World:
    """A guard, a clock, and peers that speak at their usual rates."""

    def __init__(self, **options):
        self.permit = MotionPermit([BASE, DOCK], GuardSettings(**options))
        self.now = 100.0
        self.cancels = []
        self.sent = []
        self.simulated = True  # whether a simulator is connected

    def do(self, decision):
        self.cancels += [cancel.goal_id for cancel in decision.cancels]
        self.sent.append(decision.send)
        return decision

    def status(self, *goals, server=BASE):
        return self.do(self.permit.status(server, [GoalReport(*goal) for goal in goals], self.now))

    def lease(self, held=(), suspended=(), owner="/host", life="1"):
        return self.do(self.permit.lease(BASE, owner, life, held, suspended, self.now))

    def cancel(self, goal_id="", stamp=0):
        return self.do(self.permit.cancel(BASE, goal_id, stamp, self.now))

    def drive(self):
        """Whether a velocity passes now."""
        return self.do(self.permit.command(True, self.now)).send is Send.COMMAND

    def after(self, seconds, goals=None, held=None, commands=True):
        """Lets time pass; the motion server, the owner and navigation go on speaking unless they are None."""
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += 0.05
            if goals is not None:
                self.status(*goals)
            if held is not None:
                self.lease(held)
            if commands:
                self.do(self.permit.command(True, self.now))
            self.do(self.permit.tick(self.now, simulated=self.simulated))
        return self

    @property
    def state(self):
        return self.permit.view.state

    @property
    def reason(self):
        return self.permit.view.reason


DRIVING = [("a", ACTIVE)]


def driving(**options):
    """A world whose goal `a` is held by its owner and drives."""
    world = World(**options)
    world.lease(["a"])
    world.status(*DRIVING)
    assert world.drive()
    return world
