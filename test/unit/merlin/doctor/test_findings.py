# SPDX-License-Identifier: Apache-2.0
"""What the doctor says of each fault; of a robot that is well, nothing."""

from typing import Any, Iterable, List

import pytest

from merlin.doctor.findings import (
    GUARD_TYPE,
    STATUS_TYPE,
    VELOCITY_TYPE,
    Finding,
    Graph,
    Heard,
    Machine,
    judge_graph,
    judge_heard,
    judge_machine,
)

GOAL_TYPE = "move_base_msgs/MoveBaseActionGoal"
TYPES = {
    "/cmd_vel": VELOCITY_TYPE,
    "/cmd_vel_in": VELOCITY_TYPE,
    "/merlin/guard": GUARD_TYPE,
    "/move_base/status": STATUS_TYPE,
    "/move_base/goal": GOAL_TYPE,
    "/clock": "rosgraph_msgs/Clock",
}
PUBLISHERS = {
    "/cmd_vel": ["/guard"],
    "/cmd_vel_in": ["/move_base"],
    "/merlin/guard": ["/guard"],
    "/move_base/status": ["/move_base"],
    "/move_base/goal": ["/host"],
}
SUBSCRIBERS = {"/cmd_vel": ["/base"], "/cmd_vel_in": ["/guard"], "/move_base/goal": ["/move_base"]}
STATUSES = ["/move_base/status"]
WELL = Heard(ahead={"/move_base/status": -0.1, "/tf": 0.05}, parents={"odom": ["map"], "base_link": ["odom"]})


def graph(publishers: Any = None, subscribers: Any = None, **other: Any) -> Graph:
    """A robot that is well, but for what is given by topic."""
    return Graph({**PUBLISHERS, **(publishers or {})}, {**SUBSCRIBERS, **(subscribers or {})}, TYPES, **other)


def wrong(findings: Iterable[Finding]) -> List[str]:
    return [each.text for each in findings if each.wrong]


def test_of_a_robot_that_is_well_nothing_is_said() -> None:
    assert not [*judge_machine(Machine()), *judge_graph(graph()), *judge_heard(WELL, STATUSES)]


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"python": (3, 7)}, "Python 3.7 is too old"),
        ({"missing": ["smach"]}, "cannot import smach; run 'make build PROFILE=robot'"),
        ({"planner": False}, "no planner: kairos, which needs Python 3.10, is not installed for this 3.8"),
        ({"free": {"/logs": 20}}, "only 20 MB are free for /logs"),
        ({"free": {"/logs": -1}}, "/logs cannot be written"),
        ({"host": "ann", "host_resolves": False}, "'127.0.1.1 ann' into /etc/hosts"),
        ({"address": "ROS_IP=10.0.0.9", "address_is_own": False}, "ROS_IP=10.0.0.9 is not an address of"),
        ({"master": ""}, "ROS_MASTER_URI is not http://host:port"),
        ({"master_is_elsewhere": True}, "set ROS_IP"),
        # A line in /etc/hosts here is of no use to the other computer.
        ({"master_is_elsewhere": True, "host": "ann", "host_resolves": False}, "set ROS_IP"),
    ],
)
def test_a_computer(fault: Any, said: str) -> None:
    (text,) = wrong(judge_machine(Machine(**fault)))
    assert said in text


@pytest.mark.parametrize(
    ("known", "said"),
    [
        ({"sound": "no card"}, "no card"),
        ({"master_is_elsewhere": True, "address": "ROS_IP=10.0.0.2", "patient_tcp": False}, "Linux 6.15"),
    ],
)
def test_what_should_be_known_is_not_wrong(known: Any, said: str) -> None:
    (finding,) = judge_machine(Machine(**known))
    assert said in finding.text and not finding.wrong


def test_a_planner_of_the_users_own_does_without_kairos() -> None:
    assert not wrong(judge_machine(Machine(planner=False), planner_command=True))


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"silent": {"/camera": "refused"}}, "/camera does not answer (refused)"),
        (
            {"silent": {"/eye": "unknown", "/arm": "unknown"}, "misnamed": {"/eye": "ann", "/arm": "ann"}},
            "/arm, /eye cannot be reached from here at 'ann', so nothing of it arrives; set ROS_IP on its",
        ),
        ({"simulated_time": True}, "nothing publishes /clock"),
        ({"publishers": {"/clock": ["/sim"]}}, "/sim publishes /clock, /use_sim_time is false"),
        (
            {"publishers": {"/clock": ["/bag", "/sim"]}, "simulated_time": True},
            "/bag, /sim all publish /clock",
        ),
        ({"publishers": {"/cmd_vel": ["/guard", "/joy"]}}, "/joy publishes on /cmd_vel, past the guard"),
        ({"publishers": {"/cmd_vel_in": []}}, "nothing sends on /cmd_vel_in, which the guard reads"),
        ({"subscribers": {"/cmd_vel": []}}, "no base listens to /cmd_vel of /guard"),
        (
            {"publishers": {"/merlin/guard": [], "/cmd_vel": ["/joy", "/nav"], "/cmd_vel_in": []}},
            "no guard is between /joy, /nav and /cmd_vel",
        ),
        (
            {
                "publishers": {
                    "/merlin/guard": ["/guard"],
                    "/b/merlin/guard": ["/other"],
                    "/cmd_vel": ["/guard", "/other"],
                }
            },
            "/guard, /other all guard /cmd_vel",
        ),
        (
            {"publishers": {"/move_base/status": ["/a", "/b"]}},
            "/a, /b all serve the action /move_base; leave one",
        ),
        (
            {"subscribers": {"/move_base/goal": []}},
            "/host uses the action /move_base, which nothing serves",
        ),
    ],
)
def test_a_graph(fault: Any, said: str) -> None:
    robot = graph(**fault)._replace(types={**TYPES, "/b/merlin/guard": GUARD_TYPE})
    (text,) = wrong(judge_graph(robot))
    assert said in text


def test_a_dead_guard_is_none() -> None:
    said = wrong(judge_graph(graph({"/cmd_vel": ["/guard", "/joy"]}, silent={"/guard": "refused"})))
    assert any("no guard is between /joy and /cmd_vel" in text for text in said)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"ahead": {}}, "/move_base/status was silent for 3.5 s"),
        ({"ahead": {**WELL.ahead, "/tf": 1.5}}, "/tf is 1.5 s ahead of the clock here"),
        ({"ahead": {"/move_base/status": -2.0}}, "/move_base/status is 2.0 s behind the clock here"),
        ({"parents": {"base_link": ["odom", "map"], "odom": ["map"]}}, "base_link has the parents map, odom"),
        ({"parents": {"base_link": ["odom"], "kitchen": ["map"]}}, "tf: nothing connects map, odom"),
        ({"health": {"executor": (2, "the knowledge base is gone")}}, "executor: the knowledge base is gone"),
    ],
)
def test_what_is_published(fault: Any, said: str) -> None:
    (text,) = wrong(judge_heard(WELL._replace(**fault), STATUSES))
    assert said in text


def test_a_warning_is_to_be_known() -> None:
    heard = WELL._replace(health={"bridges": (1, "no machine")}, guards={"/merlin/guard": "set base_timeout"})
    findings = list(judge_heard(heard, STATUSES))
    assert [each.text for each in findings] == ["bridges: no machine", "/merlin/guard: set base_timeout"]
    assert not wrong(findings)
