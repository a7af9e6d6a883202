#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""A process to be killed or interrupted while it serves an action or executes a state; prints the outcome."""

import sys
import threading

import actionlib
import rospy
from actionlib.msg import TestAction, TestFeedback, TestGoal
from std_msgs.msg import Int32
from std_srvs.srv import Trigger, TriggerResponse

import smach
import smach_ros
from merlin_sm.state_factory import MerlinStateFactory


def serve():
    """An action server that never ends a goal other than 0, and says by feedback that it has one."""

    def on_goal(goal):
        goal.set_accepted()
        if goal.get_goal().goal == 0:
            goal.set_succeeded()
        goals.append(goal)

    goals = []
    server = actionlib.ActionServer(
        rospy.get_name().strip("/"), TestAction, on_goal, lambda goal: None, False
    )
    server.start()
    while not rospy.is_shutdown():
        for goal in goals:
            if goal.get_goal().goal:
                goal.publish_feedback(TestFeedback())
        rospy.rostime.wallsleep(0.05)


class Waits(smach.State):
    """Waits until it is preempted."""

    def __init__(self, obeys=True, serves=True):
        smach.State.__init__(self, outcomes=["done", "preempted"])
        self.obeys, self.serves, self.asked = obeys, serves, threading.Event()

    def request_preempt(self):
        smach.State.request_preempt(self)
        self.asked.set()

    def execute(self, ud):
        print("running", flush=True)
        self.asked.wait()
        if not self.obeys:
            threading.Event().wait()
        if not self.serves:
            return "done"
        self.service_preempt()
        return "preempted"


def container(kind):
    if kind == "concurrence":
        made = smach.Concurrence(["done", "preempted"], "done")
        with made:
            smach.Concurrence.add("A", Waits())
    elif kind == "iterator":
        made = smach.Iterator(["done", "preempted"], [], [], it=[1, 2])
        with made:
            smach.Iterator.set_contained_state("A", Waits())
    elif kind == "stubborn_concurrence":
        made = smach.Concurrence(["done"], "done")
        with made:
            smach.Concurrence.add("A", Waits(obeys=False))
    else:
        made = smach.StateMachine(["done", "preempted"])
        with made:
            smach.StateMachine.add("A", Waits())
    return made


def execute(state):
    print("outcome", state.execute(smach.UserData()))


def running(*args):
    print("running", flush=True)
    return True


def hang(request):
    running()
    threading.Event().wait()
    return TriggerResponse()


def accept(goal):
    goal.set_accepted()
    running()


def drive(kind):
    """A program as many are: its machine goes on when nothing preempts it."""
    goal = TestGoal(goal=1)  # a cancel ends it

    def action():
        if kind == "merlin_drive":
            return MerlinStateFactory().create("action", "tempers", TestAction, goal=goal)
        return smach_ros.SimpleActionState("tempers", TestAction, goal=goal)

    sm = smach.StateMachine(["succeeded", "aborted", "preempted"])
    with sm:
        if kind == "late_drive":
            smach.StateMachine.add("WAIT", Waits(serves=False), {"done": "A"})
        smach.StateMachine.add("A", action(), {"preempted": "preempted" if kind == "late_drive" else "B"})
        smach.StateMachine.add("B", action())
    return sm


def main(scenario):
    if scenario == "server":
        rospy.init_node("victim")
        return serve()
    rospy.init_node("interrupted", anonymous=True)
    if scenario == "main_thread":
        state = container("machine")
        smach_ros.set_preempt_handler(state)
        return execute(state)
    if scenario == "wrapper":
        outcomes = {"succeeded_outcomes": ["done"], "preempted_outcomes": ["preempted"]}
        smach_ros.ActionServerWrapper("victim", TestAction, container("machine"), **outcomes).run_server()
        return rospy.spin()
    if scenario in ("machine", "concurrence", "iterator", "stubborn_concurrence"):
        state = container(scenario)
        if scenario != "stubborn_concurrence":
            smach_ros.set_preempt_handler(state)
    elif "drive" in scenario:
        state = drive(scenario)
        if scenario == "late_drive":
            smach_ros.set_preempt_handler(state)
    elif scenario == "monitor":
        publisher = rospy.Publisher("ticks", Int32, latch=True, queue_size=1)
        publisher.publish(1)
        state = smach_ros.MonitorState("ticks", Int32, running)
    elif scenario == "condition":
        state = smach_ros.ConditionState(
            lambda ud: not running(), poll_rate=rospy.Duration(3600), max_checks=-1
        )
    elif scenario == "service":
        rospy.Service(
            "~hangs", Trigger, lambda request: running() and threading.Event().wait() and TriggerResponse()
        )
        state = smach_ros.ServiceState("~hangs", Trigger)
    elif scenario == "action":
        server = actionlib.ActionServer(
            "~busy", TestAction, lambda g: g.set_accepted() or running(), lambda g: None, False
        )
        server.start()
        state = smach_ros.SimpleActionState(rospy.resolve_name("~busy"), TestAction)
    else:
        state = smach_ros.SimpleActionState("nowhere", TestAction)
        if scenario == "merlin_wait_for_action":
            goal = TestGoal()
            state = MerlinStateFactory().create("action", "nowhere", TestAction, goal, server_wait=3600.0)
        threading.Timer(0.2, running).start()
    # As programs do: the machine in a thread, the main thread waits for the shutdown.
    thread = threading.Thread(target=execute, args=(state,))
    thread.start()
    rospy.spin()
    thread.join()
    return None


if __name__ == "__main__":
    main(sys.argv[1])
