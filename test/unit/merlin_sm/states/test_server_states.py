# SPDX-License-Identifier: Apache-2.0
"""States that use action servers: which goal they send, and what each end of it means for the machine."""

import threading
import time
from typing import Any, Callable, List

import pytest
from actionlib_msgs.msg import GoalStatus
from fakes.action_server import Server, userdata
from geometry_msgs.msg import PoseStamped
from merlin_msgs.msg import GuardStatus, ListenResult
from std_msgs.msg import Header

from merlin_ros.actions import hang_watch
from merlin_ros.actions.hang_watch import HUNG, HangWatch
from merlin_ros.master.master_link import MasterSilent
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states import action_state, navigation
from merlin_sm.states.action_state import ActionState
from merlin_sm.states.dialogue import AskSM
from merlin_sm.states.knowledge import KnowledgeState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, GivenUp, MerlinState
from merlin_sm.states.navigation import NavigationState
from merlin_sm.states.recognition import DetectState
from merlin_sm.states.speech import MISUNDERSTOOD, ListenState, SpeakState
from merlin_sm.states.while_state import WhileSM
from merlin_test import LONG
from smach import InvalidTransitionError


def state(goal: Any = "goal", **options: Any) -> ActionState:
    return ActionState("drive", object, goal, **options)


@pytest.mark.parametrize(
    ("status", "text", "outcome", "reason"),
    [
        (GoalStatus.SUCCEEDED, "fine", SUCCEEDED, ""),
        (GoalStatus.ABORTED, "no way", ABORTED, "/server aborted: no way"),
        (GoalStatus.ABORTED, "", ABORTED, "/server aborted"),
        (GoalStatus.REJECTED, "too far", ABORTED, "/server refused the goal: too far"),
        (GoalStatus.PREEMPTED, "", ABORTED, "/server was preempted by another client"),
        (
            GoalStatus.RECALLED,
            "no",
            ABORTED,
            "/server recalled the goal: another client cancelled it, or sent a newer one: no",
        ),
        (GoalStatus.LOST, "it died", ABORTED, "/server was lost: it died"),
    ],
)
def test_how_the_servers_end_ends_the_state(
    server: Server, status: int, text: str, outcome: str, reason: str
) -> None:
    server.end = (status, text, None)
    drive = state()
    drive.served_goal = "owner-1"
    assert drive.execute(userdata()) == outcome
    assert (drive.reason, drive.given_up, server.owners) == (reason, False, ["owner-1"])


def test_after_a_hang_a_cancel_is_read_before_a_goal_is_sent(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    missed = [0.0]  # s
    watch = HangWatch(lambda: time.monotonic() + missed[0])
    watch.beat()
    missed[0] = 2 * HUNG
    monkeypatch.setattr(action_state, "hangs", watch)
    monkeypatch.setattr(hang_watch, "LONGEST", 60.0)  # the cancel may come late
    drive = state()
    threading.Timer(0.05, drive.request_preempt).start()
    assert drive.execute(userdata()) == PREEMPTED
    assert server.goals == []


def test_a_server_that_does_not_come_is_named(server: Server) -> None:
    server.there = False
    drive = state(server_wait=0.5)
    assert drive.execute(userdata()) == ABORTED
    assert drive.reason == "not there within 0.5 s" and server.goals == []


def test_a_preempt_while_the_server_is_waited_for_sends_nothing(server: Server) -> None:
    drive = state()

    def leave(timeout: float, unless: Callable[[], bool]) -> bool:
        drive.request_preempt()
        return not unless()

    server.wait_for_server = leave  # type: ignore[method-assign]
    assert drive.execute(userdata()) == PREEMPTED and server.goals == []


def test_a_preempt_cancels_the_goal_and_waits_for_its_stop(server: Server) -> None:
    server.end, server.at_once = (GoalStatus.PREEMPTED, "", None), False
    drive = state()
    server.on_goal = drive.request_preempt
    assert drive.execute(userdata()) == PREEMPTED
    assert (drive.unstopped, server.given_up) == ("", [])


@pytest.mark.parametrize(
    ("status", "text", "outcome", "reason"),
    [
        (GoalStatus.PREEMPTED, "late", PREEMPTED, "cancelled"),
        (GoalStatus.ABORTED, "Canceled", PREEMPTED, "cancelled: Canceled"),
        (GoalStatus.ABORTED, "", PREEMPTED, "cancelled"),
        (GoalStatus.REJECTED, "busy", PREEMPTED, "cancelled: busy"),
        (GoalStatus.SUCCEEDED, "there", SUCCEEDED, ""),
        (GoalStatus.LOST, "it died", ABORTED, "/server was lost: it died"),
    ],
)
def test_however_a_server_ends_a_goal_that_was_cancelled_it_has_stopped(
    server: Server, status: int, text: str, outcome: str, reason: str
) -> None:
    server.end, server.at_once = (status, text, None), False
    drive = state()
    server.on_goal = drive.request_preempt
    assert (drive.execute(userdata()), drive.reason) == (outcome, reason)


class Fails(MerlinState):
    """Fails as soon as it may."""

    def __init__(self, begin: threading.Event, outcome: str) -> None:
        super().__init__()
        self._begin, self._ends_with = begin, outcome

    def run(self, userdata: Any) -> str:
        assert self._begin.wait(LONG)
        return self.fail("no messages") if self._ends_with == ABORTED else self._ends_with


@pytest.mark.parametrize(
    ("watched", "outcome", "reason"), [(SUCCEEDED, "stopped", ""), (ABORTED, ABORTED, "no messages")]
)
def test_a_drive_that_a_watch_ends_is_no_drive_that_failed(
    server: Server, watched: str, outcome: str, reason: str
) -> None:
    server.end, server.at_once = (GoalStatus.ABORTED, "Canceled", None), False
    drives = threading.Event()
    server.on_goal = drives.set
    both = WhileSM(state(), Fails(drives, watched), "stopped")
    assert (both.execute(userdata()), both.reason) == (outcome, reason)
    machine = MerlinSM([*both.get_registered_outcomes()])
    with machine:
        machine.add("BOTH", both)
    drives.clear()
    assert (machine.execute(userdata()), machine.reason) == (outcome, reason)


def test_a_server_that_does_not_stop_is_named_and_its_goal_given_up(server: Server) -> None:
    server.at_once = server.stops = False
    drive = state(cancel_limit=0.25)
    server.on_goal = drive.request_preempt
    assert drive.execute(userdata()) == ABORTED
    assert drive.reason == "/server did not stop within 0.25 s"
    assert (drive.unstopped, server.given_up) == ("/server", ["it did not stop in time"])
    server.at_once, server.on_goal = True, lambda: None
    drive.service_preempt()
    assert drive.execute(userdata()) == SUCCEEDED and drive.unstopped == "", "the next run begins anew"


@pytest.mark.parametrize(
    "error, final", [(ValueError("no such room"), False), (GivenUp("no such room"), True)]
)
def test_a_goal_that_cannot_be_made_aborts_with_its_text(
    server: Server, error: Exception, final: bool
) -> None:
    def goal(_: Any) -> Any:
        raise error

    drive = state(goal)
    assert drive.execute(userdata()) == ABORTED
    assert (drive.reason, drive.given_up, server.goals) == ("no such room", final, [])


def test_a_result_may_choose_the_outcome_after_success_only(server: Server) -> None:
    seen: List[Any] = []

    def keep(_: Any, result: Any) -> str:
        seen.append(result)
        return "empty"

    drive = state(on_result=keep, outcomes=["empty"])
    server.end = (GoalStatus.SUCCEEDED, "", "result")
    assert drive.execute(userdata()) == "empty" and seen == ["result"]
    server.end = (GoalStatus.ABORTED, "", "result")
    assert drive.execute(userdata()) == ABORTED and seen == ["result"]


def test_a_result_that_cannot_be_used_aborts_with_the_text_of_its_function(server: Server) -> None:
    def refuse(_: Any, result: Any) -> str:
        raise ValueError(f"{result} is not a place")

    drive = state(on_result=refuse)
    server.end = (GoalStatus.SUCCEEDED, "", "result")
    assert drive.execute(userdata()) == ABORTED and drive.reason == "result is not a place"


def test_an_answer_to_the_result_that_is_not_an_outcome_is_no_success(server: Server) -> None:
    machine = MerlinSM([SUCCEEDED, ABORTED, PREEMPTED])
    with machine:
        machine.add("DRIVE", state(on_result=lambda *_: False))
    with pytest.raises(InvalidTransitionError, match="DRIVE.*ended with False"):
        machine.execute()


# --- the ready states ----------------------------------------------------------------------------------


def test_a_robot_drives_to_a_point_or_a_pose(server: Server) -> None:
    assert NavigationState().execute(userdata(target="kitchen")) == SUCCEEDED
    pose = PoseStamped()
    pose.pose.position.x = 7.0
    assert NavigationState(pose).execute(userdata()) == SUCCEEDED
    kitchen, other = (goal.target_pose for goal in server.goals)
    assert (kitchen.header.frame_id, kitchen.pose.position.x, kitchen.pose.position.y) == ("map", 1.0, 2.0)
    assert kitchen.pose.orientation.w == 1.0 and other is pose


def test_a_point_that_does_not_exist_is_given_up_and_one_without_numbers_is_not(server: Server) -> None:
    drive = NavigationState()
    assert drive.execute(userdata(target="roof")) == ABORTED
    assert drive.given_up and "unknown point of interest 'roof'" in drive.reason
    assert drive.reason.endswith("has: broken, kitchen")
    assert drive.execute(userdata(target="broken")) == ABORTED
    assert not drive.given_up and "needs numbers x, y (m) and yaw (rad)" in drive.reason


@pytest.mark.parametrize("points", [["kitchen"], "kitchen", None, MasterSilent("the master does not answer")])
@pytest.mark.usefixtures("server")
def test_points_that_cannot_be_read_are_named(monkeypatch: pytest.MonkeyPatch, points: Any) -> None:
    def get_param(name: str, default: Any) -> Any:
        if isinstance(points, Exception):
            raise points
        return points

    monkeypatch.setattr(navigation, "get_param", get_param)
    drive = NavigationState("kitchen")
    assert drive.execute(userdata()) == ABORTED
    assert drive.reason.startswith(("world/points_of_interest is ", "the master does not answer"))


def test_nothing_sets_off_while_the_guard_forbids_it(server: Server) -> None:
    server.guard.why_not = lambda preempted, server: "the velocity guard has stopped the base"
    drive = NavigationState("kitchen")
    assert drive.execute(userdata()) == ABORTED
    assert drive.reason == "the velocity guard has stopped the base" and server.goals == []


def test_the_guard_is_asked_about_the_server_of_the_drive(server: Server) -> None:
    asked: List[str] = []
    server.guard.why_not = lambda preempted, server: asked.append(server) or ""
    assert NavigationState("kitchen", action="base/drive").execute(userdata()) == SUCCEEDED
    assert asked == [server.name]


def test_an_arrival_of_which_the_guard_knows_better_does_not_count(server: Server) -> None:
    server.guard.why_unmoved = lambda mark, server: f"{server} says so, but nothing passed"
    drive = NavigationState("kitchen")
    assert drive.execute(userdata()) == ABORTED
    assert drive.reason == f"{server.name} says so, but nothing passed"
    server.end = (GoalStatus.ABORTED, "no way", None)
    assert drive.execute(userdata()) == ABORTED and "no way" in drive.reason


@pytest.mark.parametrize("named", [True, False])
def test_another_action_that_drives_is_known_from_the_guard(server: Server, named: bool) -> None:
    server.guard.names = lambda name: named and name == server.name
    server.guard.why_unmoved = lambda mark, server: "nothing passed"
    assert state().execute(userdata()) == (ABORTED if named else SUCCEEDED)
    server.guard.why_not = lambda preempted, server: "it is stopped"
    dock = state()
    assert dock.execute(userdata()) == (ABORTED if named else SUCCEEDED)
    assert dock.reason == ("it is stopped" if named else "") and len(server.goals) == (1 if named else 2)


@pytest.mark.parametrize("stops", [True, False])
def test_a_goal_for_which_no_velocity_comes_is_cancelled_and_its_server_named(
    server: Server, stops: bool
) -> None:
    server.end, server.at_once, server.stops = (GoalStatus.PREEMPTED, "", None), False, stops
    drive = NavigationState("kitchen", cancel_limit=0.25)

    def say(*goals: str) -> None:
        assert server.guard.follows.wait(LONG)
        for take in list(server.guard.followers):
            take(GuardStatus(uncommanded=goals))
            take(GuardStatus(uncommanded=goals))

    def tell() -> None:
        say("another's")
        assert server.sents[-1].cancels == 0
        say("another's", "mine")

    guard = threading.Thread(target=tell)
    server.on_goal = guard.start
    assert drive.execute(userdata()) == ABORTED
    guard.join(LONG)
    assert server.name in drive.reason and "sent no velocity" in drive.reason
    assert ("did not stop within 0.25 s" in drive.reason) is not stops
    assert server.sents[-1].cancels == 1 and bool(server.given_up) is not stops


def test_why_a_server_did_not_stop_is_reported(server: Server) -> None:
    server.at_once = server.stops = False
    drive = state(cancel_limit=0.25)

    def preempt() -> None:
        server.sents[-1].said = "accepted"
        server.sents[-1].on_cancel = "it is not stopped: OSError: no brake"
        drive.request_preempt()

    server.on_goal = preempt
    assert drive.execute(userdata()) == ABORTED
    assert drive.reason == "/server did not stop within 0.25 s: it is not stopped: OSError: no brake"


def test_a_preempt_while_the_guard_is_asked_sends_nothing(server: Server) -> None:
    drive = NavigationState("kitchen")

    def preempt(preempted: Callable[[], bool], server: str) -> str:
        drive.request_preempt()
        assert preempted()
        return ""

    server.guard.why_not = preempt
    assert drive.execute(userdata()) == PREEMPTED and server.goals == []


def test_names_of_pddl_are_spoken_with_blanks(server: Server) -> None:
    speak = SpeakState("Is {table} free?", voice="en", volume=0.5)
    assert speak.execute(userdata(table="table_4")) == SUCCEEDED
    said = server.goals[0].sound_request
    assert (said.arg, said.arg2, said.volume) == ("Is table 4 free?", "en", 0.5)
    assert SpeakState().execute(userdata(text="snake_case stays")) == SUCCEEDED
    assert server.goals[1].sound_request.arg == "snake_case stays"


def test_a_text_may_name_fields_and_forms_of_what_it_says(server: Server) -> None:
    speak = SpeakState("{pose.header.frame_id}, {left:.1f} m")
    pose = PoseStamped(header=Header(frame_id="base_link"))
    assert speak.execute(userdata(pose=pose, left=2.04)) == SUCCEEDED
    assert server.goals[0].sound_request.arg == "base link, 2.0 m"


@pytest.mark.usefixtures("server")
@pytest.mark.parametrize("state", [SpeakState, lambda text: KnowledgeState([text])], ids=["speak", "facts"])
@pytest.mark.parametrize("text", ["(at {who})", "(at {place.nothing})", "(at {place:d})"])
def test_a_text_that_cannot_be_filled_aborts(state: Any, text: str) -> None:
    made = state(text)
    assert made.execute(userdata(place="kitchen")) == ABORTED
    assert f"the text '{text}' cannot be filled" in made.reason


@pytest.mark.parametrize("timeout", [-1.0, float("nan"), "3"])
def test_a_listener_waits_for_a_number_of_seconds(timeout: Any) -> None:
    with pytest.raises(ValueError, match=f"timeout is {timeout!r}"):
        ListenState("#JSGF V1.0; grammar g; public <answer> = yes;", timeout)


@pytest.mark.parametrize("share", [float("nan"), -0.1, 1.1, "0.5"])
def test_a_volume_and_a_score_are_from_0_to_1(share: Any) -> None:
    with pytest.raises(ValueError, match="volume is .* from 0 to 1"):
        SpeakState("Hello.", volume=share)
    with pytest.raises(ValueError, match="least_score is .* from 0 to 1"):
        DetectState("cup", least_score=share)


@pytest.mark.parametrize("attempts", [0, 2.5, "3", None])
def test_a_question_is_asked_a_whole_number_of_times(attempts: Any) -> None:
    with pytest.raises(ValueError, match=f"attempts is {attempts!r}"):
        AskSM("Ready?", "#JSGF V1.0; grammar g; public <answer> = yes;", attempts=attempts)


def test_nothing_to_say_is_an_error(server: Server) -> None:
    speak = SpeakState()
    assert speak.execute(userdata(text="  ")) == ABORTED
    assert speak.reason == "there is no text to say" and server.goals == []


@pytest.mark.parametrize(("heard", "outcome"), [("a coffee", SUCCEEDED), ("", MISUNDERSTOOD)])
def test_what_was_heard_is_kept(server: Server, heard: str, outcome: str) -> None:
    server.end = (GoalStatus.SUCCEEDED, "", ListenResult(text=heard))
    data = userdata()
    assert (
        ListenState("#JSGF V1.0; grammar g; public <order> = a coffee;", timeout=4.0).execute(data) == outcome
    )
    assert (data.heard, server.goals[0].timeout.to_sec()) == (heard, 4.0)
