# SPDX-License-Identifier: Apache-2.0
"""The engine: clients of many threads, and still each request ends once and one runs at a time."""

import random
import threading
from typing import List, Optional, Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from merlin_executor.core.agenda import Agenda
from merlin_executor.core.engine import Engine, Stages
from merlin_executor.core.outcome import Outcome, Verdict
from merlin_executor.core.ticket import Ticket
from merlin_executor.core.time_window import TimeWindow
from merlin_executor.goals.goal_ledger import GoalNotes
from merlin_test import LONG


class Wish(Ticket):
    """A request of the test's."""

    def __init__(self, order: int, priority: int = 0, resumes: bool = True) -> None:
        super().__init__(order, priority, resumes)
        self.verdicts: List[Verdict] = []
        self.ended = threading.Event()
        self.goals = "(wish)"

    @property
    def text(self) -> str:
        return self.goals

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

    def run_requests(self, requests: Sequence[Wish]) -> Verdict:
        self.at_once += 1
        self.runs += 1
        assert self.at_once == 1
        try:
            cancelled = self._cancelled.wait(self._random.uniform(0.0, 0.004))
            kind = self._random.random()
            if kind < 0.1:
                raise SystemExit("the test's") if kind < 0.05 else Unsayable()
            if cancelled:
                late = kind < 0.3
                return Verdict(Outcome.CANCEL_TIMEOUT if late else Outcome.CANCELLED, "stopped")
            return Verdict(Outcome.SUCCEEDED if kind < 0.8 else Outcome.ACTION_FAILED, "ran")
        finally:
            self.at_once -= 1

    def clean_up(self) -> None:
        self.cleaned += 1
        raise OSError("and cleaning up fails too")


class Unsayable(Exception):
    def __str__(self) -> str:
        raise AttributeError("users' code, too")


class Steady(Stages[Wish]):
    """Stages that run until they are cancelled."""

    def __init__(self) -> None:
        self.begun = threading.Semaphore(0)
        self.cancelled = threading.Event()

    def prepare(self) -> None:
        self.cancelled.clear()

    def cancel(self) -> None:
        self.cancelled.set()

    def run_requests(self, requests: Sequence[Wish]) -> Verdict:
        self.begun.release()
        assert self.cancelled.wait(LONG)
        return Verdict(Outcome.CANCELLED, "stopped")

    def clean_up(self) -> None:
        pass


@settings(max_examples=25)
@given(st.integers(0, 2**32), st.sampled_from([1, 6]))
def test_clients_of_many_threads(seed: int, together: int) -> None:
    work = Work(seed)
    reported: List[Optional[BaseException]] = []
    engine: Engine[Wish] = Engine(
        work,
        lambda: None,
        lambda: None,
        lambda wish, verdict: None,
        lambda wish, verdict, error: reported.append(error),
        Agenda(together=together),
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
    assert engine.agenda.running is None and engine.waiting == []
    assert len(reported) == work.runs if together == 1 else len(reported) >= work.runs
    assert work.cleaned == sum(error is not None for error in reported)


def test_one_of_several_that_run_together_ends_before_the_others() -> None:
    stages = Steady()
    said: List[str] = []
    engine: Engine[Wish] = Engine(
        stages,
        lambda: said.append("status"),
        lambda: None,
        lambda wish, verdict: said.append(verdict.reason),
        lambda *_: None,
        Agenda(together=3),
    )
    engine.start()
    engine.decide(lambda agenda: agenda.pause(True))
    wishes = [Wish(order) for order in range(3)]
    for wish in wishes:
        engine.decide(lambda agenda, wish=wish: agenda.receive(wish))
    engine.decide(lambda agenda: agenda.pause(False))
    assert stages.begun.acquire(timeout=LONG)
    assert engine.agenda.together == wishes
    holds = Verdict(Outcome.SUCCEEDED, "the goal holds")
    engine.achieved(wishes[:1], holds)
    assert wishes[0].verdicts == [holds] and said == ["the goal holds", "status"]
    engine.decide_on(lambda wish: wish is wishes[2], lambda agenda, found: agenda.cancel(found))
    assert wishes[2].ended.wait(LONG)
    assert stages.begun.acquire(timeout=LONG), "the other one goes on"
    assert engine.agenda.together == [wishes[1]] and not wishes[1].verdicts
    engine.shutdown(LONG)
    assert [len(wish.verdicts) for wish in wishes] == [1, 1, 1]


def test_an_end_that_cannot_be_published_keeps_neither_the_answer_nor_the_next_request() -> None:
    def failing(*_: object) -> None:
        raise OSError("the topic is closed")

    engine: Engine[Wish] = Engine(Work(3), lambda: None, lambda: None, failing, failing)
    engine.start()
    for order in range(20):
        wish = Wish(order)
        engine.decide(lambda agenda, wish=wish: agenda.receive(wish))
        assert wish.ended.wait(LONG)
        assert wish.verdicts[0].reason
    engine.shutdown(LONG)


def broken(*_: object) -> None:
    raise OSError("the topic is closed")


def test_a_queue_and_a_status_that_cannot_be_published_keep_no_answer() -> None:
    work = Steady()
    engine: Engine[Wish] = Engine(work, broken, broken, broken, broken)
    engine.start()
    first, second, third = Wish(1), Wish(2), Wish(3)
    for wish in (first, second):
        engine.decide(lambda agenda, wish=wish: agenda.receive(wish))
    assert work.begun.acquire(timeout=LONG)
    engine.decide_on(second.__eq__, lambda agenda, found: agenda.cancel(found))
    assert second.ended.wait(LONG)
    engine.decide_on(first.__eq__, lambda agenda, found: agenda.cancel(found))
    assert first.ended.wait(LONG)
    engine.agenda.breakpoints.set(["(stop here)"])
    third.goals = "(stop here)"
    engine.decide(lambda agenda: agenda.receive(third))
    engine.shutdown(LONG)
    assert [wish.verdicts[0].outcome for wish in (first, second, third)] == [Outcome.CANCELLED] * 3


def test_it_asks_to_look_when_a_request_may_begin() -> None:
    times: List[Optional[float]] = []
    engine: Engine[Wish] = Engine(Steady(), *[lambda *_: None] * 4, Agenda(), times.append)  # type: ignore[list-item]
    later = Wish(1)
    later.window = TimeWindow(not_before=30.0)
    engine.decide(lambda agenda: agenda.receive(later))
    assert times == [30.0]
    engine.decide_on(later.__eq__, lambda agenda, found: agenda.cancel(found))
    assert times == [30.0, None]


@pytest.mark.parametrize("part", ["begin", "prepare", "end", "cancel"])
def test_a_request_whose_code_fails_ends_neither_the_worker_nor_the_other_requests(part: str) -> None:
    work = Steady()
    engine: Engine[Wish] = Engine(work, *[lambda *_: None] * 4)  # type: ignore[list-item]
    engine.start()
    bad, good = Wish(1), Wish(2)
    setattr(work if part in ("prepare", "cancel") else bad, part, broken)
    engine.decide(lambda agenda: agenda.receive(bad))
    if part in ("end", "cancel"):
        assert work.begun.acquire(timeout=LONG)
        engine.decide_on(bad.__eq__, lambda agenda, found: agenda.cancel(found))
        work.cancelled.set()
    else:
        assert bad.ended.wait(LONG)
        assert bad.verdicts[0].outcome is Outcome.INTERNAL
        assert "the topic is closed" in bad.verdicts[0].reason
    vars(work).pop(part, None)
    engine.decide(lambda agenda: agenda.receive(good))
    assert work.begun.acquire(timeout=LONG)
    engine.shutdown(LONG)
    assert good.ended.wait(LONG)


def test_an_answer_that_fails_at_the_end_keeps_no_other_one() -> None:
    engine: Engine[Wish] = Engine(Steady(), *[lambda *_: None] * 4)  # type: ignore[list-item]
    wishes = [Wish(order) for order in range(3)]
    wishes[1].end = broken  # type: ignore[assignment]
    for wish in wishes:
        engine.decide(lambda agenda, wish=wish: agenda.receive(wish))
    engine.decide(lambda agenda: agenda.close())
    assert [len(wish.verdicts) for wish in wishes] == [1, 0, 1]


def test_an_answer_that_fails_once_is_given_with_the_reason() -> None:
    engine: Engine[Wish] = Engine(Steady(), *[lambda *_: None] * 4)  # type: ignore[list-item]
    wish = Wish(0)

    def fail_once(_: Verdict) -> bool:
        del wish.end  # type: ignore[attr-defined]
        raise RuntimeError("dictionary changed size during iteration")

    wish.end = fail_once  # type: ignore[method-assign]
    engine.decide(lambda agenda: agenda.receive(wish))
    engine.decide(lambda agenda: agenda.close())
    (verdict,) = wish.verdicts
    assert verdict.outcome is Outcome.INTERNAL and "changed size" in verdict.reason


# --- what makes sense -----------------------------------------------------------------------------------


def test_notes_survive_and_other_files_are_no_notes(tmp_path: object) -> None:
    path = f"{tmp_path}/folder/goals"
    assert GoalNotes(path).read() == []
    GoalNotes(path).write(["(checked kitchen)"])
    assert GoalNotes(path).read() == ["(checked kitchen)"]
    GoalNotes(path).path.write_text('{"a": 1}')
    with pytest.raises(ValueError, match="is not a list of goals"):
        GoalNotes(path).read()


class Leaving(Work):
    """Stages whose goals stay in a knowledge base that does not answer at first."""

    def __init__(self, failures: int) -> None:
        super().__init__(0)
        self._failures = failures
        self._left = False
        self.tidied = threading.Event()

    def run_requests(self, requests: Sequence[Wish]) -> Verdict:
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
    engine: Engine[Wish] = Engine(stages, lambda: None, lambda: None, lambda *_: None, lambda *_: None)
    engine.start()
    wish = Wish(0)
    engine.decide(lambda agenda: agenda.receive(wish))
    assert wish.ended.wait(LONG)
    assert stages.tidied.wait(LONG)
    engine.shutdown(LONG)
