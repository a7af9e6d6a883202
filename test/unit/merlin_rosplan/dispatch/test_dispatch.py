# SPDX-License-Identifier: Apache-2.0
"""The dispatch logic against a world that the test controls."""

import threading
import time
from dataclasses import replace

import pytest
from dispatch_world import GUARDED, LIGHT, PLAN_ID, WORK, Run, World, actions, parallel

from merlin_rosplan.dispatch.dispatch import PlanDispatch
from merlin_rosplan.dispatch.dispatch_environment import (
    DispatchLimits,
    DispatchState,
    FeedbackStatus,
    KnowledgeChanged,
    Tick,
)
from merlin_rosplan.dispatch.dispatch_graph import SequentialSchedule
from merlin_rosplan.dispatch.operator_model import PlanTerm, TimedEffects
from merlin_test import LONG


@pytest.fixture
def world():
    return World(WORK, GUARDED, LIGHT)


def test_actions_run_in_order_and_a_tombstone_closes_the_dispatch(world):
    run = Run(world, SequentialSchedule(actions("work", "work")))
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    world.wait("action", 1)
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    report = run.report()
    assert report.success and report.steps_done == 2
    assert [entry for entry in world.published if entry[0] in ("action", "tombstone")] == [
        ("action", 0),
        ("action", 1),
        ("tombstone", 1),
    ]


def test_a_suspended_dispatch_starts_nothing_until_it_goes_on(world):
    run = Run(world, SequentialSchedule(actions("work", "work")))
    world.wait("action", 0)
    run.dispatch.suspend(True)
    run.feedback(0, FeedbackStatus.ENABLED)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    run.dispatch.put(Tick())
    with world.changed_event:
        assert world.changed_event.wait_for(lambda: any(each.steps_done == 1 for each in world.reports), LONG)
    assert world.reports[-1].state == DispatchState.RUNNING
    assert ("action", 1) not in world.published and not run.dispatch.ended.is_set()
    run.dispatch.suspend(False)
    world.wait("action", 1)
    run.feedback(1, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_a_suspended_dispatch_can_be_cancelled(world):
    run = Run(world, SequentialSchedule(actions("work")))
    world.wait("action", 0)
    run.dispatch.suspend(True)
    run.dispatch.cancel("its owner is gone")
    world.wait("cancel", 0)
    run.feedback(0, FeedbackStatus.FAILED)
    report = run.report()
    assert report.state == DispatchState.CANCELLED and report.reason == "its owner is gone"


def test_an_empty_plan_succeeds_and_publishes_nothing(world):
    assert Run(world, SequentialSchedule([])).report().success
    assert world.published == []


@pytest.mark.parametrize(
    ("reason", "reported"),
    [
        ("the door is shut", "(work o0) failed: the door is shut"),
        ("(work o0) did not end within 60 s", "(work o0) did not end within 60 s"),
        ("", "(work o0) failed"),
    ],
)
def test_a_failed_action_ends_the_dispatch_with_its_reason_and_is_named_once(world, reason, reported):
    run = Run(world, SequentialSchedule(actions("work", "work")))
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.FAILED, reason=reason)
    report = run.report()
    assert report.state == DispatchState.FAILED
    assert report.failed_action.id == 0 and report.reason == reported
    assert ("action", 1) not in world.published and world.published.count(("tombstone", 0)) == 1


@pytest.mark.parametrize(
    "facts, missing",
    [
        ({PlanTerm("safe", ("o0",))}, "(free o0) does not hold"),
        (
            {PlanTerm("safe", ("o0",)), PlanTerm("free", ("o0",)), PlanTerm("blocked", ("o0",))},
            "(blocked o0) holds",
        ),
        ({PlanTerm("free", ("o0",))}, "(safe o0) does not hold"),
    ],
)
def test_an_unmet_condition_stops_before_the_action(world, facts, missing):
    world.facts = facts
    report = Run(world, SequentialSchedule(actions("guarded"))).report()
    assert report.state == DispatchState.FAILED and missing in report.reason
    assert world.published == [("own 0", 0)]  # nothing dispatched, so nothing to close either


def test_an_over_all_condition_that_breaks_cancels_the_action(world):
    world.facts = {PlanTerm("free", ("o0",)), PlanTerm("safe", ("o0",))}
    run = Run(world, SequentialSchedule(actions("guarded", "work")))
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    world.facts = {PlanTerm("safe", ("o0",))}
    run.dispatch.put(KnowledgeChanged(frozenset({"free"})))  # an at-start condition may go
    world.facts = set()
    run.dispatch.put(KnowledgeChanged(frozenset({"safe"})))
    world.wait("cancel", 0)
    run.feedback(0, FeedbackStatus.FAILED, reason="cancelled")
    report = run.report()
    assert report.state == DispatchState.FAILED and "(safe o0) does not hold" in report.reason
    assert not report.unanswered


def test_an_action_may_end_its_own_over_all_condition(world):
    run = Run(world, SequentialSchedule(actions("light")))
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    world.facts = {PlanTerm("burning", ("o0",))}
    run.dispatch.put(KnowledgeChanged())
    world.wait_answers(2)  # before the start, and once it runs
    world.facts = set()  # the end effects, before the interface reports the end
    run.dispatch.put(KnowledgeChanged())
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_an_over_all_condition_that_the_start_brings_about_may_come_later(world):
    world.operators["keep"] = replace(LIGHT, name="keep", end_effects=TimedEffects())
    run = Run(world, SequentialSchedule(actions("keep")))
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    run.dispatch.put(KnowledgeChanged())
    world.wait_answers(2)  # before the start, and once it runs
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success


@pytest.mark.parametrize("grace", [0.05, 0.0])
def test_an_action_whose_own_over_all_condition_goes_without_an_end_fails(world, grace):
    run = Run(world, SequentialSchedule(actions("light")), over_all_grace=grace, cancel=0.05)
    world.wait("action", 0)
    world.facts = {PlanTerm("burning", ("o0",))}
    run.dispatch.put(KnowledgeChanged())
    world.wait_answers(2)
    world.facts = set()
    run.dispatch.put(KnowledgeChanged())
    report = run.report()
    assert report.state == DispatchState.FAILED and "(burning o0) does not hold" in report.reason


def test_a_missing_interface_is_named(world):
    report = Run(world, SequentialSchedule(actions("work")), acknowledge=0.05, cancel=0.05).report()
    assert report.state == DispatchState.FAILED and report.reason == "no action interface for work"
    assert ("tombstone", 0) in world.published


def test_a_dead_interface_is_noticed_while_its_action_runs(world):
    world.silences["work"] = 0.01
    made = world.deadline

    def deadline(seconds):
        if seconds == 0.05:  # it has taken the action
            world.silences["work"] = 6.0
        return made(seconds)

    world.deadline = deadline
    run = Run(world, SequentialSchedule(actions("work")), liveness=0.05)
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    report = run.report()
    assert "the action interface of work is gone" in report.reason


def test_a_dead_interface_that_never_announced_itself_is_noticed_too(world):
    run = Run(world, SequentialSchedule(actions("work")), liveness=0.05)
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    world.left.add(0)
    report = run.report()
    assert report.state == DispatchState.FAILED
    assert report.reason == "the action interface of work is gone, silent for 0.05 s"


@pytest.mark.parametrize("liveness", [LONG, None])
def test_one_that_has_connected_anew_may_still_end_its_action(world, liveness):
    run = Run(world, SequentialSchedule(actions("work")), liveness=liveness)
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    world.left.add(0)
    run.dispatch.put(KnowledgeChanged())
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_an_interface_that_comes_back_and_takes_the_action_is_alive(world):
    world.silences["work"] = 100.0  # until its first announcement arrives
    run = Run(world, SequentialSchedule(actions("work")), liveness=LONG)
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    run.dispatch.put(KnowledgeChanged())
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_announcements_of_an_earlier_interface_do_not_count_for_one_that_makes_none(world):
    world.silences["work"] = 57.0
    run = Run(world, SequentialSchedule(actions("work", "work")), liveness=0.05)
    for action, silence in ((0, 57.2), (1, 57.4)):
        world.wait("action", action)
        run.feedback(action, FeedbackStatus.ENABLED)
        world.silences["work"] = silence
        run.dispatch.put(KnowledgeChanged())
        assert not run.dispatch.ended.wait(0.1)
        run.feedback(action, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_a_living_interface_may_take_its_time(world):
    world.silences["work"] = 0.1
    run = Run(world, SequentialSchedule(actions("work")), acknowledge=0.02, accept=LONG)
    world.wait("action", 0)
    time.sleep(0.1)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success
    assert world.published.count(("action", 0)) == 1


def test_a_young_interface_gets_the_action_once_more(world):
    world.silences["work"] = 0.1
    world.just_announced_operators.add("work")
    run = Run(world, SequentialSchedule(actions("work")), acknowledge=0.02)
    with world.changed_event:
        assert world.changed_event.wait_for(lambda: world.published.count(("action", 0)) == 2, LONG)
    run.feedback(0, FeedbackStatus.ENABLED)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_a_living_interface_that_never_takes_the_action_is_given_up(world):
    world.silences["work"] = 0.1
    report = Run(
        world, SequentialSchedule(actions("work")), acknowledge=0.02, accept=0.05, cancel=0.05
    ).report()
    assert "did not take (work o0)" in report.reason and [a.id for a in report.unanswered] == [0]


def test_cancel_waits_for_the_answer(world):
    run = Run(world, SequentialSchedule(actions("work", "work")))
    world.wait("action", 0)
    run.feedback(0, FeedbackStatus.ENABLED)
    run.dispatch.cancel()
    world.wait("cancel", 0)
    assert not run.dispatch.ended.wait(0.05)
    run.feedback(0, FeedbackStatus.FAILED, reason="cancelled")
    report = run.report()
    assert report.state == DispatchState.CANCELLED and not report.unanswered
    assert world.published[-1] == ("tombstone", 0) and ("action", 1) not in world.published


def test_a_cancelled_action_that_succeeds_is_the_last_one(world):
    run = Run(world, SequentialSchedule(actions("work", "work")), cancel=None)
    world.wait("action", 0)
    run.dispatch.cancel()
    world.wait("cancel", 0)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    report = run.report()
    assert report.state == DispatchState.CANCELLED and report.steps_done == 1
    assert ("action", 1) not in world.published


@pytest.mark.parametrize("said", [[], [FeedbackStatus.FAILED], [FeedbackStatus.SUCCEEDED]])
def test_who_does_not_answer_a_cancel_is_named(world, said):
    run = Run(world, SequentialSchedule(actions("work")), cancel=0.05)
    world.wait("action", 0)
    run.dispatch.cancel()
    world.wait("cancel", 0)
    for status in said:  # latched since an earlier run
        run.feedback(0, status, 0)
    report = run.report()
    assert [a.id for a in report.unanswered] == [
        0
    ] and "no answer to the cancel from (work o0)" in report.reason


def test_a_cancel_before_the_first_action_dispatches_nothing(world):
    dispatch = PlanDispatch(SequentialSchedule(actions("work")), world, DispatchLimits(), PLAN_ID)
    dispatch.cancel("no")
    assert dispatch.run().state == DispatchState.CANCELLED
    assert world.published == []


def test_feedback_of_other_plans_and_unknown_actions_is_ignored(world):
    run = Run(world, SequentialSchedule(actions("work", "work")))
    world.wait("action", 0)
    for plan_id, action_id in ((PLAN_ID - 1, 0), (PLAN_ID, 1), (PLAN_ID, 99), (0, 0)):
        run.feedback(action_id, FeedbackStatus.SUCCEEDED, plan_id)  # the last one was never taken
    run.feedback(0, FeedbackStatus.ENABLED, 0)
    run.feedback(0, FeedbackStatus.SUCCEEDED, 0)
    world.wait("action", 1)
    run.feedback(1, FeedbackStatus.FAILED)
    assert run.report().steps_done == 1


def test_answers_reported_twice_count_once(world):
    run = Run(world, SequentialSchedule(actions("work", "work", "work")))
    for action_id in range(3):
        world.wait("action", action_id)
        for _ in range(3):
            run.feedback(action_id, FeedbackStatus.SUCCEEDED)
    report = run.report()
    assert report.success and report.steps_done == 3


def test_parallel_actions_start_together_and_one_failure_cancels_the_others(world):
    run = Run(world, parallel(["work", "work", "work"]))
    for action_id in range(3):
        world.wait("action", action_id)
    run.feedback(0, FeedbackStatus.SUCCEEDED)
    run.feedback(1, FeedbackStatus.FAILED, reason="broken")
    world.wait("cancel", 2)
    assert ("cancel", 0) not in world.published and ("cancel", 1) not in world.published
    run.feedback(2, FeedbackStatus.FAILED, reason="cancelled")
    report = run.report()
    assert report.state == DispatchState.FAILED and report.failed_action.id == 1 and "broken" in report.reason
    assert [kind for kind, _ in world.published].count("tombstone") == 1


def test_actions_are_sent_before_the_report_that_names_them(world):
    named = []
    world.on_send = lambda action: named.append(
        [each.id for report in world.reports for each in report.running]
    )
    run = Run(world, parallel(["work", "work"]))
    world.wait("action", 1)
    with world.changed_event:
        assert world.changed_event.wait_for(lambda: world.reports, LONG)
    assert named == [[], []]
    assert [each.id for each in world.reports[0].running] == [0, 1]
    run.dispatch.cancel()
    for action_id in (0, 1):
        run.feedback(action_id, FeedbackStatus.FAILED)
    assert run.report().state == DispatchState.CANCELLED


def test_a_report_names_first_what_is_to_end_first(world):
    run = Run(world, parallel(["work", "work"], durations=[900.0, 4.0]))
    with world.changed_event:
        assert world.changed_event.wait_for(lambda: world.reports, LONG)
    assert [each.id for each in world.reports[0].running] == [1, 0]
    for action_id in (0, 1):
        run.feedback(action_id, FeedbackStatus.SUCCEEDED)
    assert run.report().success


def test_a_knowledge_base_that_does_not_answer_ends_the_dispatch(world):
    world.broken = True
    report = Run(world, SequentialSchedule(actions("guarded"))).report()
    assert report.state == DispatchState.FAILED and "does not answer" in report.reason


def test_after_a_mistake_of_the_world_what_runs_is_stopped(world):
    def send(action):
        if action.id == 1:
            raise RuntimeError("no room on the wire")

    world.on_send = send
    run = Run(world, parallel(["work", "work"]), cancel=LONG)
    world.wait("cancel", 0)
    world.wait("cancel", 1)
    for action_id in (0, 1):
        run.feedback(action_id, FeedbackStatus.FAILED, reason="cancelled")
    report = run.report()
    assert (report.state, report.reason) == (DispatchState.FAILED, "RuntimeError: no room on the wire")
    assert not report.unanswered and world.published[-1] == ("tombstone", 1)


def test_an_answer_in_the_middle_of_sending_is_not_lost(world):
    holder = []
    world.on_send = lambda action: holder[0].feedback(action.id, FeedbackStatus.SUCCEEDED)
    dispatch_ready = threading.Event()
    original = world.send

    def send(action):
        dispatch_ready.wait(LONG)
        original(action)

    world.send = send
    holder.append(Run(world, SequentialSchedule(actions(*["work"] * 50))))
    dispatch_ready.set()
    assert holder[0].report().steps_done == 50
