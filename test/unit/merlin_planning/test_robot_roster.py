# SPDX-License-Identifier: Apache-2.0
"""Which robots count when a node names robots without end."""

from unittest import mock

from hypothesis import given
from hypothesis import strategies as st

from merlin_planning import robot_roster
from merlin_planning.robot_roster import KEEP, OF_ALL, OF_ONE, RobotRoster


def test_a_node_that_names_robots_without_end_costs_no_other_one_a_robot() -> None:
    roster = RobotRoster()
    assert roster.admit("r1", "/r1/host", 0.0).counts
    reported = [roster.admit(f"ghost{number}", "/flood", 0.0) for number in range(10 * OF_ALL)]
    assert sum(admission.counts for admission in reported) == OF_ONE
    refusals = [admission.refusal for admission in reported if admission.refusal]
    assert refusals == [f"/flood names more than {OF_ONE} robots; further ones of it do not count"]
    assert roster.admit("r1", "/r1/host", 0.2).counts and roster.admit("r2", "/r2/host", 0.2).counts


def test_a_node_of_which_the_name_is_not_known_is_one_node() -> None:
    roster = RobotRoster()
    assert sum(roster.admit(f"ghost{number}", "", 0.0).counts for number in range(OF_ALL)) == OF_ONE


def test_a_robot_that_is_gone_makes_room_and_one_that_is_there_does_not() -> None:
    roster = RobotRoster()
    for number in range(OF_ONE):
        roster.admit(f"r{number}", "/relay", 0.0)
    for number in range(1, OF_ONE):
        roster.admit(f"r{number}", "/relay", KEEP)
    assert not roster.admit("new", "/relay", KEEP).counts
    later = KEEP + 0.1
    assert roster.admit("new", "/relay", later) == (True, "r0", "")
    assert "r0" not in roster and "r1" in roster and "new" in roster
    assert not roster.admit("r0", "/relay", later).counts


def test_nodes_that_name_robots_without_end_push_out_none_that_is_there() -> None:
    roster = RobotRoster()
    assert roster.admit("r1", "/r1/host", 0.0).counts
    counted = [roster.admit(f"ghost{number}", f"/flood{number}", 1.0).counts for number in range(2 * OF_ALL)]
    assert sum(counted) == OF_ALL - 1 and "r1" in roster
    (forgotten,) = {roster.admit("r2", "/r2/host", 1.1 + KEEP).forgotten}
    assert forgotten == "r1", "it has been silent for longest"


_names = st.sampled_from([f"r{number}" for number in range(12)])


@given(st.lists(st.tuples(_names, st.sampled_from(["/a", "/b", "/c"]), st.floats(0.0, KEEP)), max_size=300))
def test_what_counts_is_known_and_what_is_forgotten_is_not(messages) -> None:
    known, now = set(), 0.0
    with mock.patch.multiple(robot_roster, OF_ONE=3, OF_ALL=6):
        roster = RobotRoster()
        for robot, sender, seconds in messages:
            now += seconds
            admission = roster.admit(robot, sender, now)
            if admission.forgotten:
                known.remove(admission.forgotten)
            if admission.counts:
                known.add(robot)
            assert admission.counts == (robot in known) == (robot in roster)
            assert len(known) <= 6 and all(robot in roster for robot in known)
