"""The engine: clients of many threads, and still each request ends once and one runs at a time."""

import random
import threading
from typing import List, Optional

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_executor.core.engine import Engine, Job, Stages
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.goals.goal_notes import GoalNotes, NotesError
from merlin_executor.goals.goal_rules import GoalError, check_atom

LONG = 60.0


class Wish(Job):
    """A request of the test's."""

    def __init__(self, order: int, priority: int = 0, resumes: bool = True) -> None:
        super().__init__(order, priority, resumes)
        self.verdicts: List[Verdict] = []
        self.ended = threading.Event()

    def end(self, verdict: Verdict) -> bool:
        self.verdicts.append(verdict)
        self.ended.set()
        return True


class Work(Stages[Wish]):
    """Stages that take a random, short time, and fail, crash and obey as a seed says."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._cancelled = threading.Event()
        self.at_once = 0
        self.runs = 0
        self.cleaned = 0

    def prepare(self) -> None:
        self._cancelled.clear()

    def cancel(self) -> None:
        self._cancelled.set()

    def run_request(self, request: Wish) -> Verdict:
        self.at_once += 1
        self.runs += 1
        assert self.at_once == 1
        try:
            cancelled = self._cancelled.wait(self._random.uniform(0.0, 0.004))
            kind = self._random.random()
            if kind < 0.1:
                raise SystemExit("the test's")
            if cancelled:
                late = kind < 0.3
                return Verdict(Outcome.CANCEL_TIMEOUT if late else Outcome.CANCELLED, "stopped")
            return Verdict(Outcome.SUCCEEDED if kind < 0.8 else Outcome.ACTION_FAILED, "ran")
        finally:
            self.at_once -= 1

    def clean_up(self) -> None:
        self.cleaned += 1
        raise OSError("and cleaning up fails too")


@settings(max_examples=25)
@given(st.integers(0, 2**32))
def test_clients_of_many_threads(seed: int) -> None:
    work = Work(seed)
    told: List[Optional[BaseException]] = []
    engine: Engine[Wish] = Engine(
        work, lambda: None, lambda: None, lambda wish, verdict, error: told.append(error)
    )
    engine.start()
    wishes = [Wish(order, order % 3, resumes=order % 2 == 0) for order in range(24)]

    def client(mine: List[Wish], number: int) -> None:
        choice = random.Random(seed + number)
        for wish in mine:
            engine.decide(lambda agenda, wish=wish: agenda.receive(wish))
            if choice.random() < 0.4:
                engine.decide_on(wish.__eq__, lambda agenda, found: agenda.cancel(found))

    threads = [threading.Thread(target=client, args=(wishes[n::4], n)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LONG)
    for wish in wishes[: seed % 24]:
        assert wish.ended.wait(LONG)
    engine.shutdown(LONG)
    assert all(wish.ended.wait(LONG) for wish in wishes)
    assert all(len(wish.verdicts) == 1 for wish in wishes)
    assert engine.running is None and engine.waiting == []
    assert len(told) == work.runs
    assert work.cleaned == sum(error is not None for error in told)


def test_an_end_that_cannot_be_published_keeps_neither_the_answer_nor_the_next_request() -> None:
    def failing(wish: Wish, verdict: Verdict, error: Optional[BaseException]) -> None:
        raise OSError("the topic is closed")

    engine: Engine[Wish] = Engine(Work(3), lambda: None, lambda: None, failing)
    engine.start()
    for order in range(20):
        wish = Wish(order)
        engine.decide(lambda agenda, wish=wish: agenda.receive(wish))
        assert wish.ended.wait(LONG)
        assert wish.verdicts[0].reason
    engine.shutdown(LONG)


# --- what makes sense -----------------------------------------------------------------------------------

KNOWN = {"robot_at": 1, "Between": 2}


def test_names_do_not_depend_on_case() -> None:
    check_atom("(ROBOT_AT Kitchen)", "predicate", "ROBOT_AT", ["Kitchen"], KNOWN, {"kitchen"})
    check_atom("(between a b)", "predicate", "between", ["a", "b"], KNOWN, {"a", "b"})


@pytest.mark.parametrize(
    ("name", "arguments", "why"),
    [
        ("at", [], "the domain has no predicate 'at', only Between, robot_at"),
        ("robot_at", [], "'robot_at' takes 1 arguments, not 0"),
        ("robot_at", ["moon"], "there is no object 'moon'"),
    ],
)
def test_what_makes_no_sense_says_why(name: str, arguments: List[str], why: str) -> None:
    with pytest.raises(GoalError, match=why):
        check_atom("(g)", "predicate", name, arguments, KNOWN, {"kitchen"})


def test_notes_survive_and_other_files_are_no_notes(tmp_path: object) -> None:
    path = f"{tmp_path}/folder/goals"
    assert GoalNotes(path).read() == []
    GoalNotes(path).write(["(checked kitchen)"])
    assert GoalNotes(path).read() == ["(checked kitchen)"]
    GoalNotes(path).path.write_text('{"a": 1}')
    with pytest.raises(NotesError, match="is not a list of goals"):
        GoalNotes(path).read()


class Leaving(Work):
    """Stages whose goals stay in a knowledge base that does not answer at first."""

    def __init__(self, failures: int) -> None:
        super().__init__(0)
        self._failures = failures
        self._left = False
        self.tidied = threading.Event()

    def run_request(self, request: Wish) -> Verdict:
        self._left = True
        return Verdict(Outcome.SUCCEEDED)

    @property
    def left(self) -> bool:
        return self._left

    def clean_up(self) -> None:
        self._failures -= 1
        if self._failures >= 0:
            raise OSError("does not answer")
        self._left = False
        self.tidied.set()


def test_what_a_request_has_left_is_removed_without_another_request(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("merlin_executor.core.engine.TIDY_PERIOD", 0.001)
    stages = Leaving(failures=3)
    engine: Engine[Wish] = Engine(stages, lambda: None, lambda: None, lambda *_: None)
    engine.start()
    wish = Wish(0)
    engine.decide(lambda agenda: agenda.receive(wish))
    assert wish.ended.wait(LONG)
    assert stages.tidied.wait(LONG)
    engine.shutdown(LONG)
