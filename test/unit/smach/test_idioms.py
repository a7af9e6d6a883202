# SPDX-License-Identifier: Apache-2.0
"""What users write: small programs and the output that SMACH's documentation promises them.

``idioms/*.txt`` holds the programs. Each runs by itself, with the classes below.
"""

import contextlib
import io
import threading
from pathlib import Path
from typing import Any, Dict, Iterator, List, NamedTuple

import pytest

import smach

LIMIT = 60.0  # s after which a program counts as hanging


class Say(smach.State):
    """Prints a text and ends."""

    def __init__(self, text: Any, outcome: str = "done", outcomes: Any = None) -> None:
        smach.State.__init__(self, outcomes=outcomes or [outcome])
        self.text, self.outcome = text, outcome

    def execute(self, userdata: Any) -> str:
        print(self.text)
        return self.outcome


class Act(smach.State):
    """Ends with what a function of its userdata returns."""

    def __init__(self, act: Any, outcomes: Any = ("done",), **keys: Any) -> None:
        smach.State.__init__(self, outcomes=list(outcomes), **keys)
        self.act = act

    def execute(self, userdata: Any) -> Any:
        return self.act(userdata)


class Wait(smach.State):
    """Waits until it is preempted or released."""

    def __init__(self, serves: bool = True) -> None:
        smach.State.__init__(self, outcomes=["done", "preempted"])
        self.serves, self.ended = serves, ""
        self.started, self.release = threading.Event(), threading.Event()

    def request_preempt(self) -> None:
        smach.State.request_preempt(self)
        self.release.set()

    def execute(self, userdata: Any) -> str:
        self.started.set()
        assert self.release.wait(LIMIT)
        self.release.clear()
        self.ended = "done"
        if self.serves and self.preempt_requested():
            self.service_preempt()
            self.ended = "preempted"
        return self.ended


def run(state: Any) -> Any:
    """Executes a state or a container in a machine."""
    sm = smach.StateMachine(state.get_registered_outcomes())
    with sm:
        smach.StateMachine.add("RUN", state)
    return sm.execute()


def machine(state: Any) -> Any:
    """A machine of one state, A."""
    sm = smach.StateMachine(state.get_registered_outcomes())
    with sm:
        smach.StateMachine.add("A", state)
    return sm


def preempted(container: Any, *states: Any) -> Any:
    """Executes a container, and preempts it when the states have begun."""
    outcomes: List[Any] = []
    thread = threading.Thread(target=lambda: outcomes.append(container.execute()), daemon=True)
    thread.start()
    for state in states:
        assert state.started.wait(LIMIT)
    container.request_preempt()
    thread.join(LIMIT)
    return outcomes[0]


class Idiom(NamedTuple):
    """A program and what it prints."""

    title: str
    program: str
    output: str


def idioms() -> Iterator[Idiom]:
    """All of them."""
    for path in sorted((Path(__file__).parent / "idioms").glob("*.txt")):
        for part in path.read_text().split("\n== ")[1:]:
            title, _, text = part.partition("\n")
            lines = text.rstrip().split("\n")
            said = [line[3:] for line in lines if line.startswith("-> ")]
            program = "\n".join(line for line in lines if not line.startswith("-> "))
            yield Idiom(f"{path.stem}: {title}", program, "\n".join(said) + "\n")


IDIOMS = list(idioms())


@pytest.fixture(autouse=True)
def quiet() -> Iterator[None]:
    """Nothing is logged; what a program changes in smach is put back."""
    names = "loginfo", "logwarn", "logdebug", "logerr", "is_shutdown"
    saved: Dict[str, Any] = {name: getattr(smach, name) for name in names}
    smach.set_loggers(*[lambda text: None] * 4)
    smach.set_shutdown_check(lambda: False)
    yield
    vars(smach).update(saved)


@pytest.mark.parametrize("idiom", IDIOMS, ids=[idiom.title for idiom in IDIOMS])
def test_idiom_prints_what_the_documentation_promises(idiom: Idiom) -> None:
    names: Dict[str, Any] = {"__name__": "program", "smach": smach}
    names.update(Say=Say, Act=Act, Wait=Wait, run=run, machine=machine, preempted=preempted)
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(compile(idiom.program, idiom.title, "exec"), names)
    assert output.getvalue() == idiom.output


def test_there_are_enough_of_them() -> None:
    assert len(IDIOMS) >= 150
    assert len({idiom.title for idiom in IDIOMS}) == len(IDIOMS)
