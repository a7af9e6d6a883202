# SPDX-License-Identifier: Apache-2.0
"""States, machines and a way to run them that the suites of smach_ros have in common."""

import threading

import smach
from merlin_test import LONG


class Run(threading.Thread):
    """A state executed in a thread of its own."""

    def __init__(self, state, **userdata):
        super().__init__(daemon=True)
        self.state, self.ud = state, smach.UserData()
        for key, value in userdata.items():
            self.ud[key] = value
        self.start()

    def run(self):
        self.outcome = self.state.execute(self.ud)

    def end(self):
        self.join(LONG)
        assert not self.is_alive(), "hangs"
        return self.outcome


class Done(smach.State):
    def __init__(self, **keys):
        smach.State.__init__(self, outcomes=["done"], **keys)

    def execute(self, ud):
        return "done"


class Calling(smach.State):
    def __init__(self, call, outcomes=("done", "preempted"), **keys):
        smach.State.__init__(self, outcomes=list(outcomes), **keys)
        self.call = call

    def execute(self, ud):
        return self.call(self, ud)


def machine(*states, outcomes=("done", "preempted"), **keys):
    sm = smach.StateMachine(list(outcomes), **keys)
    with sm:
        for i, state in enumerate(states):
            target = "done" if i == len(states) - 1 else f"S{i + 1}"
            smach.StateMachine.add(f"S{i}", state, {"done": target})
    return sm
