# SPDX-License-Identifier: Apache-2.0
"""A day in a file: what is due when, what is sent, and how a wrong file is refused."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, Dict, Iterator, List

import pytest
import rospy
from fake_robot import FakeRobot
from merlin_msgs.msg import ExecuteResult, GoalQueue, QueuedGoal

from merlin_executor.executor_client import NEVER, lasting_id
from merlin_executor.goal_check import GoalError
from merlin_executor.mission import day as day_module
from merlin_executor.mission.day import Day, DayError, read_day
from merlin_executor.mission.goal_dispatcher import MissionFailed
from merlin_executor.mission.readiness import NotReady
from merlin_ros.service_proxy import ServiceError

EIGHT = time.mktime((2026, 11, 26, 8, 0, 0, 0, 0, -1))
HOUR, MINUTE = 3600.0, 60.0
FILE = """
- at: 10:30
  goals: (checked kitchen)
  deadline: 30min
  priority: 2
  survives: true
- every: 20min
  goals: ["(checked hall)", "(not (open door))"]
  on_interrupt: never
  value: 2.5
"""


@pytest.fixture
def day(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "day.yaml"
        path.write_text(text)
        return path

    return write


class Sent(Day):
    """Keeps what is sent; a request ends when it is due, unless `early` says how it ends at once."""

    outcome = ExecuteResult.SUCCEEDED

    def __init__(self, file: Path, most: int, clock: SimpleNamespace) -> None:
        super().__init__(file)
        self.most = most
        self.clock = clock
        self.sent: List[Dict[str, Any]] = []
        self.never: List[str] = []
        self.early: List[Any] = []
        self.begun = False
        self.found = [ExecuteResult.REFUSED]  # how those end that are followed; the last one always
        self.followed: List[str] = []
        self.client = SimpleNamespace(follow=self.follow, cancel_all=lambda: None)

    def send(self, goals: Any, **options: Any) -> Any:
        if len(self.sent) == self.most:
            raise MissionFailed("cancelled")
        on_done = options.pop("on_done")
        self.sent.append({"goals": goals, **options})
        if goals == self.never:
            return
        early = self.early.pop(0) if self.early else None
        if isinstance(early, Exception):
            raise early
        if early is None:
            self.clock.now = max(self.clock.now, options["not_before"].to_sec())
        outcome = self.outcome if early is None else early
        result = ExecuteResult(outcome=outcome, reason="why")
        taken_back = outcome == ExecuteResult.CANCELLED
        known = lasting_id(options["name"]) if options.get("survives") else "another"
        on_done(SimpleNamespace(id=known, result=result, taken_back=taken_back, begun=self.begun))

    def follow(self, request: str, on_done: Callable[[Any], None]) -> None:
        self.followed.append(request)
        outcome = self.found.pop(0) if len(self.found) > 1 else self.found[0]
        on_done(SimpleNamespace(result=ExecuteResult(outcome=outcome, reason="why"), taken_back=False))

    @property
    def due(self) -> List[float]:
        """When each that was sent is due, min after eight."""
        return [(each["not_before"].to_sec() - EIGHT) / MINUTE for each in self.sent]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The time, and the pauses; each is over at once."""
    made = SimpleNamespace(now=EIGHT, pauses=[])

    def call_after(seconds: float, call: Callable[[], None], name: str) -> Any:
        made.pauses.append(seconds)
        made.now += seconds
        call()
        return SimpleNamespace(shutdown=lambda: None)

    monkeypatch.setattr(rospy, "get_time", lambda: made.now)
    monkeypatch.setattr(day_module, "call_after", call_after, raising=False)
    for level in ("loginfo", "logwarn"):
        monkeypatch.setattr(rospy, level, lambda *_: None)
    return made


def test_each_errand_is_sent_before_it_is_due_with_its_times(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day(FILE), 3, clock)
    mission.never = ["(checked kitchen)"]
    with pytest.raises(MissionFailed, match="cancelled"):
        mission.run()
    first, second, third = mission.sent
    assert first["goals"] == ["(checked kitchen)"] and first["priority"] == 2 and first["survives"] is True
    assert first["not_before"].to_sec() == EIGHT + 2.5 * HOUR
    assert first["deadline"].to_sec() == EIGHT + 3 * HOUR
    assert second["not_before"].to_sec() == EIGHT + 20 * MINUTE and "deadline" not in second
    assert (second["on_interrupt"], second["value"]) == (NEVER, 2.5)
    assert third["goals"] == second["goals"] and third["not_before"].to_sec() == EIGHT + 40 * MINUTE
    assert first["name"] != second["name"] == third["name"]


def test_a_mission_that_begins_again_gives_an_errand_the_same_name(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    names = []
    for clock.now in (EIGHT + 1.0, EIGHT + 600.0):
        mission = Sent(day(FILE), 2, clock)
        with pytest.raises(MissionFailed):
            mission.run()
        names.append([each["name"] for each in mission.sent])
    assert names[0] == names[1]


def test_an_entry_that_was_edited_has_another_name_and_one_that_was_moved_has_not(
    day: Callable[[str], Path],
) -> None:
    entry = '- at: "08:00"\n  goals: (a)\n  survives: true\n'
    (known,) = read_day(day(entry))
    _, moved = read_day(day(f"- every: 1h\n  goals: (b)\n{entry}"))
    assert moved.name == known.name
    for old, new in (("(a)", "(c)"), ("08:00", "08:01"), ("survives", "priority: 2\n  survives")):
        (edited,) = read_day(day(entry.replace(old, new)))
        assert edited.name != known.name


def test_what_survived_and_began_before_the_mission_is_followed_to_its_end(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    file = day('- at: "07:55"\n  goals: (a)\n  survives: true\n')
    (entry,) = read_day(file)

    def run(outcome: int) -> None:
        mission = Sent(file, 0, clock)
        mission.found = [outcome]
        mission.run()
        assert mission.followed == [lasting_id(f"Sent:{entry.name}")] and not mission.sent

    run(ExecuteResult.SUCCEEDED)
    run(ExecuteResult.REFUSED)  # it has ended
    with pytest.raises(MissionFailed, match=r"1 not done, the first: .*day.yaml:1: action failed: why"):
        run(ExecuteResult.ACTION_FAILED)


def test_what_was_due_before_the_mission_is_followed_again_when_the_executor_is_lost_and_never_sent(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    file = day('- at: "07:55"\n  goals: (a)\n  survives: true\n')

    def run(*found: int) -> Sent:
        mission = Sent(file, 9, clock)
        mission.found = list(found)
        try:
            mission.run()
        finally:
            assert not mission.sent and len(set(mission.followed)) == 1
        return mission

    assert len(run(ExecuteResult.INTERNAL, ExecuteResult.SUCCEEDED).followed) == 2
    assert clock.pauses == [2.0]
    for found in [ExecuteResult.INTERNAL, ExecuteResult.REFUSED], [ExecuteResult.INTERNAL]:
        with pytest.raises(MissionFailed, match="1 not done, the first: .*day.yaml:1: internal: why"):
            run(*found)
    assert clock.now < EIGHT + 2 * HOUR


def test_what_was_due_before_the_mission_is_not_sent_either_when_the_clock_is_set_back(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day('- at: "07:55"\n  goals: (a)\n  survives: true\n'), 9, clock)
    follow = mission.client.follow

    def set_back(request: str, on_done: Callable[[Any], None]) -> None:
        clock.now = EIGHT - HOUR
        follow(request, on_done)

    mission.client.follow = set_back
    mission.found = [ExecuteResult.SUCCEEDED]
    mission.run()
    assert len(mission.followed) == 1 and not mission.sent


def test_what_was_begun_and_crashed_or_is_lost_is_not_begun_again(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day("- every: 20min\n  goals: (a)\n"), 2, clock)
    mission.outcome, mission.begun = ExecuteResult.INTERNAL, True
    with pytest.raises(MissionFailed, match="cancelled"):
        mission.run()
    assert mission.due == [20.0, 40.0] and not clock.pauses


def test_what_was_begun_and_survives_is_followed_when_the_executor_is_lost(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day("- every: 20min\n  goals: (a)\n  survives: true\n"), 2, clock)
    mission.outcome, mission.begun = ExecuteResult.INTERNAL, True
    mission.found = [ExecuteResult.INTERNAL, ExecuteResult.SUCCEEDED]
    with pytest.raises(MissionFailed, match="cancelled"):
        mission.run()
    assert mission.due == [20.0, 40.0]
    assert len(mission.followed) == 3 and clock.pauses == [2.0, 4.0, 2.0]


def test_one_that_survived_from_an_earlier_time_costs_no_later_one(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day("- every: 20min\n  goals: (a)\n  survives: true\n"), 3, clock)
    mission.early = [ExecuteResult.SUCCEEDED]
    with pytest.raises(MissionFailed, match="cancelled"):
        mission.run()
    assert mission.due == [20.0, 20.0, 40.0]


def test_what_has_passed_is_left_out_and_the_day_ends(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day('- at: "07:00"\n  goals: (a)\n- at: 10min\n  goals: (b)\n'), 9, clock)
    mission.run()
    assert [(each["goals"], each["not_before"].to_sec()) for each in mission.sent] == [(["(b)"], EIGHT + 600)]


def test_an_errand_that_is_not_done_costs_no_other_and_is_named(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day("- at: 1min\n  goals: (a)\n- at: 2min\n  goals: (b)\n"), 9, clock)
    mission.outcome = ExecuteResult.LATE
    with pytest.raises(MissionFailed, match=r"2 not done, the first: .*day.yaml:1: late: why"):
        mission.run()
    assert len(mission.sent) == 2


@pytest.mark.parametrize(
    "early",
    [ExecuteResult.REFUSED, ExecuteResult.INTERNAL, ServiceError("no answer"), GoalError("no object 'x'")],
)
def test_what_ends_before_it_is_due_is_sent_again_for_the_same_time(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace, early: Any
) -> None:
    mission = Sent(day("- every: 20min\n  goals: (a)\n"), 6, clock)
    mission.early = [early] * 3
    with pytest.raises(MissionFailed, match="cancelled"):
        mission.run()
    assert mission.due == [20.0, 20.0, 20.0, 20.0, 40.0, 60.0]
    assert clock.pauses == [2.0, 4.0, 8.0]


@pytest.mark.parametrize("entry", ["deadline: 1h", "priority: 0"])
def test_one_that_is_not_begun_in_its_time_is_a_failure_once(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace, entry: str
) -> None:
    mission = Sent(day(f"- at: 1h\n  goals: (a)\n  {entry}\n"), 99, clock)
    mission.early = [ExecuteResult.REFUSED] * 99
    with pytest.raises(MissionFailed, match=r"1 not done, the first: .*day.yaml:1: refused: why"):
        mission.run()
    assert set(mission.due) == {60.0} and EIGHT + 2 * HOUR - 5.0 < clock.now < EIGHT + 2 * HOUR
    assert max(clock.pauses) == 300.0 and len(clock.pauses) < 45


def test_an_executor_that_comes_back_when_an_errand_was_due_gets_it_in_time(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day("- at: 1s\n  goals: (a)\n  deadline: 1min\n"), 99, clock)
    mission.early = [ExecuteResult.INTERNAL, ServiceError("no answer"), ExecuteResult.REFUSED]
    mission.run()
    assert len(mission.sent) == 4 and clock.pauses == [1.0, 4.0, 8.0]
    assert {each["deadline"].to_sec() for each in mission.sent} == {EIGHT + 61.0}


@pytest.mark.parametrize("outcome", [ExecuteResult.ACTION_FAILED, ExecuteResult.LATE])
def test_one_that_was_begun_and_failed_is_not_begun_again(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace, outcome: int
) -> None:
    mission = Sent(day("- at: 1min\n  goals: (a)\n  deadline: 1h\n"), 99, clock)
    mission.outcome = outcome
    with pytest.raises(MissionFailed, match="1 not done"):
        mission.run()
    assert len(mission.sent) == 1


def test_what_is_not_begun_until_its_next_time_is_sent_for_that(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day("- every: 20min\n  goals: (a)\n"), 99, clock)
    mission.early = [ExecuteResult.REFUSED] * 30
    with pytest.raises(MissionFailed, match="cancelled"):
        mission.run()
    assert list(dict.fromkeys(mission.due))[:3] == [20.0, 40.0, 60.0]


def test_what_an_operator_takes_back_is_not_sent_again(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    mission = Sent(day("- every: 20min\n  goals: (a)\n"), 2, clock)
    mission.early = [ExecuteResult.CANCELLED]
    with pytest.raises(MissionFailed, match="cancelled"):
        mission.run()
    assert mission.due == [20.0, 40.0] and not clock.pauses


@pytest.mark.parametrize(
    ("queued", "late", "due"),
    [
        ([0.0], [], [20.0, 20.0, 40.0]),  # that of an earlier time waits when the mission begins
        ([], [], [20.0, 20.0, 40.0]),  # or runs
        ([], [0.0], [20.0, 20.0, 40.0]),
        ([0.0, 20.0], [], [20.0, 40.0, 60.0]),
        ([0.0], [20.0], [20.0, 40.0, 60.0]),  # that of this time is heard of after its end
        ([], [0.0, 20.0], [20.0, 40.0, 60.0]),
    ],
)
def test_an_earlier_one_that_is_taken_back_costs_no_later_one(
    robot: FakeRobot,
    day: Callable[[str], Path],
    clock: SimpleNamespace,
    monkeypatch: pytest.MonkeyPatch,
    queued: List[float],
    late: List[float],
    due: List[float],
) -> None:
    file = day("- every: 20min\n  goals: (a)\n  survives: true\n")
    mission = Sent(file, 3, clock)
    mission.early = [ExecuteResult.CANCELLED]
    known = lasting_id(f"Sent:{read_day(file)[0].name}")

    def say(queue: List[float]) -> None:
        for minutes in queue:
            not_before = rospy.Time.from_sec(EIGHT + minutes * MINUTE)
            for callback in robot.on_queue:
                callback(GoalQueue(requests=[QueuedGoal(request=known, not_before=not_before)]))

    def hear(goals: Any, **options: Any) -> Any:
        say(queued if not mission.sent else [])
        return Sent.send(mission, goals, **options)

    def pause(seconds: float, call: Callable[[], None], name: str) -> Any:
        say(late)
        call()
        return SimpleNamespace(shutdown=lambda: None)

    mission.send = hear  # type: ignore[method-assign]
    monkeypatch.setattr(day_module, "call_after", pause)
    with pytest.raises(MissionFailed, match="cancelled"):
        mission.run()
    assert mission.due == due


def test_a_cancel_ends_a_day_that_waits_to_send_again(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    mission = Sent(day("- at: 1h\n  goals: (a)\n"), 9, clock)
    mission.early = [ExecuteResult.REFUSED]
    shut: List[str] = []

    def call_after(seconds: float, call: Callable[[], None], name: str) -> Any:
        mission.cancel()
        return SimpleNamespace(shutdown=lambda: shut.append(name))

    monkeypatch.setattr(day_module, "call_after", call_after, raising=False)
    with pytest.raises(MissionFailed, match="the mission was cancelled"):
        mission.run()
    assert len(mission.sent) == len(shut) == 1


def test_what_takes_longer_than_its_interval_is_not_made_up_for(
    day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    (errand,) = read_day(day('- at: "08:00"\n  every: 20min\n  goals: (a)'))
    assert errand.due(EIGHT - 1.0, EIGHT - 1.0) == EIGHT
    assert errand.due(EIGHT - 1.0, EIGHT + 50 * MINUTE) == EIGHT + 60 * MINUTE
    assert errand.due(EIGHT - 1.0, EIGHT + 60 * MINUTE) == EIGHT + 80 * MINUTE


@pytest.fixture
def berlin(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with monkeypatch.context() as patched:
        patched.setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")
        time.tzset()
        yield
    time.tzset()


@pytest.mark.parametrize("month", [3, 10])
def test_every_day_is_at_the_same_time_when_the_clock_is_changed(
    berlin: None, day: Callable[[str], Path], month: int
) -> None:
    (errand,) = read_day(day('- at: "07:00"\n  every: 24h\n  goals: (a)'))
    begun = due = time.mktime((2026, month, 20, 6, 0, 0, 0, 0, -1))
    for number in range(20, 50):
        due = errand.due(begun, due) or 0.0
        assert due == time.mktime((2026, month, number, 7, 0, 0, 0, 0, -1))
        assert errand.due(begun, due - 1.0) == due


def test_in_a_simulation_intervals_count_from_zero_and_times_of_the_day_are_refused(
    robot: FakeRobot, day: Callable[[str], Path], clock: SimpleNamespace
) -> None:
    clock.now = 130.0
    (errand,) = read_day(day("- every: 1min\n  goals: (a)"))
    assert errand.due(130.0, 130.0) == 180.0
    with pytest.raises(NotReady, match=r"day.yaml:1: the robot's clock is a simulator's"):
        Day(day('- at: "08:00"\n  goals: (a)')).wait_for_robot(1.0)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("- at: '25:00'\n  goals: (a)", "day.yaml:1: at cannot be '25:00': '25:00' is not a time"),
        ("- goals: (a)\n- at: 1min\n", "day.yaml:1: an entry needs goals, and at or every\n"),
        ("- at: 1min\n  goals: (a\n", "day.yaml:1: goals cannot be '(a'"),
        ("- at: 1min\n  goals: []\n", "one text or a list of texts"),
        ("- at: 1min\n  goals: {a: b}\n", "day.yaml:1: goals cannot be"),
        ("\n- at: 1min\n  goals: (a)\n  dedline: 1min", "day.yaml:2: 'dedline' is none of at, every, goals"),
        ("- every: '08:00'\n  goals: (a)", "it has to be a duration"),
        ("- every: [1min]\n  goals: (a)", "every cannot be"),
        ("- at: 1min\n  at: 2min\n  goals: (a)", "a key stands there twice"),
        ("- at: 1min\n  goals: (a)\n  priority: high", "priority cannot be 'high'"),
        ("- at: 1min\n  goals: (a)\n  priority: 3000000000", "a whole number from -2147483647"),
        ("- at: 1min\n  goals: (a)\n  value: -1", "a number above 0"),
        ("- every: 9000h\n  goals: (a)", "'9000h' is too long"),
        ("- at: 1min\n  goals: (a)\n  on_interrupt: perhaps", "one of resume, drop, never"),
        ("- at: 1min\n  goals: (a)\n  survives: true", ":1: with survives, at has to be a time of the day"),
        ("- every: 1h\n  goals: (a)\n- every: 60min\n  goals: (a)\n", ":3: the same entry stands before"),
        ("- at: 1min\n  goals: (a)\n  priority: -2147483649", "number from -2147483647 to 2147483647"),
        ("- at: 8785h\n  goals: (a)", "day.yaml:1: at cannot be '8785h': '8785h' is too long; the longest"),
        (f"- at: {'9' * 400}h\n  goals: (a)", "the longest time is a year, 8760h"),
        ("- at: 1min\n  goals: (a)\n  deadline: 4294967296s", "deadline cannot be '4294967296s'"),
        ("- every: 0.0000001s\n  goals: (a)", "it has to be a duration of 1 s at least"),
        ("- 3", "an entry needs goals"),
        ("- [at, goals]", "an entry needs goals"),
        ("- at: [", "is not YAML"),
        ("goals: (a)", "has to be a list of 1 to 200 entries"),
        ("", "has to be a list"),
        ("- !!python/object:os.system x", "an entry needs goals"),
    ],
)
def test_a_wrong_file_is_refused_with_line_and_reason(
    day: Callable[[str], Path], text: str, why: str
) -> None:
    with pytest.raises(DayError) as error:
        read_day(day(text))
    assert why in f"{error.value}\n"


def test_the_check_names_each_goal_that_nothing_knows(day: Callable[[str], Path]) -> None:
    faults = Day.faults({"file": str(day(FILE))}.get, lambda goal: "unknown" if "hall" in goal else "")
    assert faults == [f"{day(FILE)}:7: (checked hall): unknown"]
    assert "~file is missing" in Day.faults({}.get, lambda goal: "")[0]
    assert "cannot be read" in Day.faults({"file": "/nowhere"}.get, lambda goal: "")[0]
    assert len(Day.faults({"file": str(day("- 3\n- 4\n"))}.get, lambda goal: "")) == 2
