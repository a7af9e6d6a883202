# SPDX-License-Identifier: Apache-2.0
"""What the state machines cost: transitions, preemption, and what thousands of executions leave behind."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, Dict, List

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import actionlib
import rospy
from actionlib.msg import TestAction, TestGoal
from measuring.figures import figure
from measuring.ros_process import RosMaster
from smach_msgs.msg import SmachContainerStatus, SmachContainerStructure
from std_msgs.msg import Int32

import smach
import smach_ros

TRANSITIONS = 20_000
DEPTH = 8  # containers around the leaf that is preempted
PREEMPTS = 500
EXECUTIONS = 10_000
ACTIONS = 500
MONITORS = 300
SERVER = "bench"


class Step(smach.State):
    """Does nothing, and notes when it began and ended.

    :param times: of all steps, s, in turn begin and end.
    :param limit: number of times after which it ends the machine.
    :param pause: how long it lasts, s.
    """

    def __init__(self, times: List[float], limit: int, pause: float) -> None:
        super().__init__(outcomes=["next", "end"])
        self.times, self.limit, self.pause = times, limit, pause

    def execute(self, ud: Any) -> str:
        self.times.append(time.perf_counter())
        if self.pause:
            time.sleep(self.pause)
        outcome = "next" if len(self.times) < self.limit else "end"
        self.times.append(time.perf_counter())
        return outcome


class Sleeper(smach.State):
    """Waits for a preempt request and notes when it noticed it."""

    def __init__(self) -> None:
        super().__init__(outcomes=["preempted"])
        self.asked, self.runs = threading.Event(), threading.Event()
        self.noticed = 0.0

    def request_preempt(self) -> None:
        super().request_preempt()
        self.asked.set()

    def execute(self, ud: Any) -> str:
        self.asked.clear()
        self.runs.set()
        self.asked.wait()
        self.noticed = time.perf_counter()
        self.service_preempt()
        return "preempted"


def ping_pong(transitions: int, pause: float = 0.0) -> Any:
    """A machine of two states that makes so many transitions, and the list of its times."""
    times: List[float] = []
    machine = smach.StateMachine(outcomes=["end"])
    with machine:
        smach.StateMachine.add("A", Step(times, 2 * transitions, pause), {"next": "B"})
        smach.StateMachine.add("B", Step(times, 2 * transitions, pause), {"next": "A"})
    return machine, times


def overheads_us(times: List[float]) -> List[float]:
    """Time between the end of each state and the beginning of the next."""
    return [(times[i + 1] - times[i]) * 1e6 for i in range(1, len(times) - 1, 2)]


def nest(leaf: smach.State, depth: int, concurrent: bool) -> smach.State:
    """A leaf in so many containers; with ``concurrent`` every second one has threads."""
    state = leaf
    for level in range(depth):
        outcomes = list(leaf.get_registered_outcomes())
        container: smach.Container
        if concurrent and level % 2:
            container = smach.Concurrence(outcomes, outcomes[0])
            with container:
                smach.Concurrence.add("C", state)
        else:
            container = smach.StateMachine(outcomes)
            with container:
                smach.StateMachine.add("S", state)
        state = container
    return state


def preempts_ms(concurrent: bool) -> Dict[str, float]:
    """From the request at the root to the leaf that has woken up."""
    leaf = Sleeper()
    root = nest(leaf, DEPTH, concurrent)
    samples = []
    for _ in range(PREEMPTS):
        leaf.runs.clear()
        thread = threading.Thread(target=root.execute, daemon=True)
        thread.start()
        leaf.runs.wait()
        time.sleep(0.0005)  # the leaf goes to sleep, as one that works would have long done
        begin = time.perf_counter()
        root.request_preempt()
        thread.join()
        samples.append((leaf.noticed - begin) * 1000.0)
    return figure(samples)


def memory_kb() -> int:
    """Resident memory of this process."""
    with open("/proc/self/statm") as statm:
        return int(statm.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


def subscribers() -> int:
    """Topics this process subscribes to."""
    return len(rospy.topics.get_topic_manager().get_subscriptions())


def growth(state: smach.State, executions: int) -> Dict[str, int]:
    """What is there after so many executions that was not there after the first tenth of them."""
    for _ in range(executions // 10):
        state.execute(smach.UserData())
    before = threading.active_count(), subscribers(), memory_kb()
    for _ in range(executions):
        state.execute(smach.UserData())
    after = threading.active_count(), subscribers(), memory_kb()
    threads, topics, memory = (b - a for a, b in zip(before, after))
    return {"executions": executions, "threads": threads, "subscribers": topics, "memory_kb": memory}


def partner() -> None:
    """The other process: a viewer, an action server that succeeds at once, a topic."""
    rospy.init_node("partner")
    rospy.Subscriber(f"/{SERVER}/smach/container_status", SmachContainerStatus, lambda message: None)
    rospy.Subscriber(f"/{SERVER}/smach/container_structure", SmachContainerStructure, lambda message: None)

    def succeed(goal: Any) -> None:
        goal.set_accepted()
        goal.set_succeeded()

    actionlib.ActionServer("/partner", TestAction, succeed, lambda goal: None, False).start()
    rospy.Publisher("/tick", Int32, latch=True, queue_size=1).publish(1)
    rospy.spin()


def measure() -> Dict[str, Any]:
    """All figures."""
    quiet = [lambda text: None] * 4
    smach.set_loggers(*quiet)
    results: Dict[str, Any] = {}
    machine, times = ping_pong(TRANSITIONS)
    machine.execute()
    results["smach_transition_us"] = figure(overheads_us(times))
    results["smach_preempt_leaf_ms"] = preempts_ms(concurrent=False)
    results["smach_preempt_leaf_concurrent_ms"] = preempts_ms(concurrent=True)
    with RosMaster():
        process = subprocess.Popen([sys.executable, __file__])
        try:
            results.update(measure_ros())
        finally:
            process.terminate()
            process.wait()
            rospy.signal_shutdown("done")
    return results


def measure_ros() -> Dict[str, Any]:
    """The figures that need a master."""
    rospy.init_node("bench", disable_signals=True)
    results: Dict[str, Any] = {}
    for name, pause in (
        ("smach_transition_introspection_us", 0.0),
        # States that last: every transition is published by itself.
        ("smach_transition_introspection_paced_us", 0.002),
    ):
        machine, times = ping_pong(TRANSITIONS // (20 if pause else 1), pause)
        server = smach_ros.IntrospectionServer(f"/{SERVER}", machine, "/BENCH")
        server.start()
        status = server._status_publisher
        while status is not None and not status.get_num_connections():
            time.sleep(0.01)
        machine.execute()
        results[name] = figure(overheads_us(times))
        server.stop()
    action = smach_ros.SimpleActionState("/partner", TestAction, goal=TestGoal())
    action.execute(smach.UserData())
    samples = []
    for _ in range(ACTIONS):
        begin = time.perf_counter()
        action.execute(smach.UserData())
        samples.append((time.perf_counter() - begin) * 1000.0)
    results["smach_action_state_ms"] = figure(samples)
    leaf = smach.CBState(lambda ud: "done", outcomes=["done"])
    results["smach_growth"] = growth(nest(leaf, 3, concurrent=True), EXECUTIONS)
    results["smach_growth_actions"] = growth(action, ACTIONS)
    monitor = smach_ros.MonitorState("/tick", Int32, lambda ud, message: True, max_checks=1)
    results["smach_growth_monitors"] = growth(monitor, MONITORS)
    return results


if __name__ == "__main__":
    partner()
