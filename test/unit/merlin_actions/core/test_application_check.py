# SPDX-License-Identifier: Apache-2.0
"""Mistakes of an application are found before the robot moves, and each is one sentence."""

import enum
import sys
import threading
import types

import pytest

from merlin_actions.action_classes import make_machines
from merlin_actions.core.application_check import (
    ApplicationError,
    ApplicationWorld,
    Needs,
    check_application,
    not_looked_at,
)
from merlin_actions.core.ending import no_retry
from merlin_actions.machine_survey import survey
from merlin_actions.merlin_action_server import given_up
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.merlin_state import ABORTED, GivenUp, MerlinState
from merlin_sm.states.while_state import WhileSM
from merlin_test import LONG
from smach import Concurrence, StateMachine

OUTCOMES = ["succeeded", ABORTED, "preempted"]
OPERATORS = {"navigate": [("from", "place"), ("to", "poi")], "ask": [("p", "poi")]}
NAVIGATE = Needs("Navigate", "navigate", ("from", "to"), ("to",), (), (("DRIVE", "move_base"),))
ASK = Needs("Ask", "ask", ("p",), (), (), (("SPEAK", "sound_play"),))


def world(points=("hall", "kitchen"), servers=None):
    objects = {"poi": ["hall", "kitchen"], "place": ["anywhere", "hall", "kitchen"]}
    return ApplicationWorld(OPERATORS, lambda kind: objects.get(kind, []), list(points), servers)


def test_parts_that_fit_have_no_mistakes():
    assert check_application([NAVIGATE, ASK], world(servers=["move_base", "sound_play"])) == []


@pytest.mark.parametrize(
    ("classes", "there", "said"),
    [
        ([NAVIGATE], world(), "operator ask of the domain has no class; write one with parameters = ['p']"),
        (
            [NAVIGATE, ASK, Needs("Aks", "aks")],
            world(),
            "Aks: the domain has no operator 'aks' (did you mean 'ask'?)",
        ),
        (
            [NAVIGATE, ASK._replace(parameters=("q",))],
            world(),
            "Ask declares the parameters ['q'], but operator ask",
        ),
        ([NAVIGATE, ASK, ASK._replace(name="Again")], world(), "Again and Ask both run operator ask"),
        ([NAVIGATE, ASK], world(["hall"]), "object kitchen of the problem is not a point of interest"),
        ([NAVIGATE, ASK._replace(points=("bar",))], world(), "Ask drives to 'bar', which is not a point"),
        (
            [NAVIGATE, ASK],
            world(servers=["move_base"]),
            "state SPEAK of Ask uses the action server 'sound_play'",
        ),
        ([NAVIGATE, ASK._replace(unset=("state TELL reads x",))], world(), "Ask: state TELL reads x"),
    ],
)
def test_each_mistake_is_one_sentence(classes, there, said):
    (mistake,) = check_application(classes, there)
    assert mistake.startswith(said) and "\n" not in mistake


def test_what_a_class_declares_is_judged_once_its_operator_is_known():
    there = world()._replace(declared_fault=lambda text, operator: f"{operator} has no {text}")
    wrong = [NAVIGATE, ASK._replace(declared=("(quit)",))]
    (mistake,) = check_application(wrong, there)
    assert mistake.startswith("Ask declares '(quit)': ask has no (quit); correct its while_running")
    unknown = [NAVIGATE, ASK, ASK._replace(name="Aks", operator="aks", declared=("(quit)",))]
    (mistake,) = check_application(unknown, there)
    assert "no operator 'aks'" in mistake


def test_what_is_declared_is_read_from_the_class():
    assert survey(Interrupted()).declared == ("(quiet)", "(robot_at anywhere)")


def test_a_host_of_one_action_does_not_have_to_run_all():
    assert check_application([NAVIGATE], world(), complete=False) == []


def test_what_only_a_system_that_runs_has_is_named_as_not_looked_at():
    asked = (("LOOK", "recognize", ("cup", "mug")), ("HEAR", "listen", ("yes",)))
    needs = ASK._replace(asked=asked, services=(("LIGHT", "switch_on"),))
    there = world()._replace(known={"listen": lambda words: ""})
    assert not_looked_at([needs, NAVIGATE._replace(asked=(("LOOK", "recognize", ("cup",)),))], there) == [
        "service 'switch_on' of state LIGHT of Ask: a node has to offer it",
        "whether the server of 'recognize' knows cup, mug: it is not one of MERLIN's",
    ]


class Serve(MerlinActionSM):
    parameters = ("o", "t")

    def build(self):
        self.add("DRIVE", self.state("navigation"), {"succeeded": "BAR"}, remapping={"target": "t"})
        self.add("BAR", self.state("navigation", "bar"), {"succeeded": "OFFER"})
        offer = self.state("ask", "Is this {o} right?", "#JSGF V1.0; grammar g; public <a> = yes;")
        self.add("OFFER", offer, {"succeeded": "TELL", "misunderstood": "aborted"})
        self.add("TELL", self.state("speak", "{heard}, {order}."))


def test_a_machine_tells_what_it_needs():
    needs = survey(Serve())
    assert (needs.name, needs.operator, needs.parameters) == ("Serve", "serve", ("o", "t"))
    assert needs.targets == ("t",) and needs.points == ("bar",)
    assert needs.servers == (
        ("DRIVE", "move_base"),
        ("BAR", "move_base"),
        ("OFFER/ASK", "sound_play"),
        ("OFFER/LISTEN", "listen"),
        ("OFFER/ASK_AGAIN", "sound_play"),
        ("TELL", "sound_play"),
    )
    assert needs.unset == ("state TELL reads userdata 'order', which nothing sets; there is: heard, o, t",)


class Step(enum.Enum):
    DRIVE, TELL = range(2)


class Steps(MerlinActionSM):
    parameters = ("t",)

    def build(self):
        drive = self.state("navigation")
        self.add(Step.DRIVE, drive, {"succeeded": Step.TELL}, remapping={"target": "t"})
        self.add(Step.TELL, self.state("speak", "{order}."))


def test_labels_that_are_members_of_an_enumeration_are_reported_by_their_texts():
    needs = survey(Steps())
    assert needs.servers == (("Step.DRIVE", "move_base"), ("Step.TELL", "sound_play"))
    assert needs.unset == ("state Step.TELL reads userdata 'order', which nothing sets; there is: t",)


class Broken(MerlinActionSM):
    def build(self):
        self.add("SPEAK", self.state("spaek", "Hello."))


class Unnamed(MerlinActionSM):
    parameters = ("p",)

    def build(self):
        self.add("SPEAK", self.state("speak", "{p} and {q}.", keys=["p"]))


def test_all_classes_that_cannot_be_made_are_named(monkeypatch):
    module = types.ModuleType("my_actions")
    module.Broken, module.Unnamed = Broken, Unnamed
    monkeypatch.setitem(sys.modules, "my_actions", module)
    with pytest.raises(ApplicationError) as error:
        make_machines(["my_actions:Broken", "my_actions:Unnamed", "my_actions:Gone"])
    broken, unnamed, gone = error.value.mistakes
    assert "my_actions:Broken cannot be made: KeyError" in broken and "no state 'spaek'" in broken
    assert "test_application_check.py, line" in broken
    assert "names {q}, which is not among its keys: p" in unnamed
    assert "has no Gone" in gone


class Interrupted(MerlinActionSM):
    while_running = ["(quiet)"]
    if_interrupted = ["(robot_at anywhere)"]

    def build(self):
        self.add("READ", self.state("function", lambda userdata: None))


class Nowhere(Interrupted):
    def build(self):
        self.add("READ", self.state("function", lambda userdata: None), {"succeeded": "DECIDE"})


def test_a_line_of_ours_is_not_named(monkeypatch):
    module = types.ModuleType("my_actions")
    module.Nowhere = Nowhere
    monkeypatch.setitem(sys.modules, "my_actions", module)
    with pytest.raises(ApplicationError) as error:
        make_machines(["my_actions:Nowhere"])
    (nowhere,) = error.value.mistakes
    assert "leads to 'DECIDE', which is neither" in nowhere and ", line" not in nowhere


class Prescribe(MerlinActionSM):
    def build(self):
        self.add("READ", self.state("function", lambda userdata: None), {"succeeded": "DECIDE"})
        self.add("DECIDE", self.state("function", self._decide))

    def _decide(self, userdata):
        raise GivenUp("the pharmacist said no")


class Refuse(Prescribe):
    def build(self):
        self.add("DECIDE", self.state("function", self._decide))


class Round(MerlinActionSM):
    """Its only state acts, and gives up when it is entered again."""

    def build(self):
        self.visited = False
        visit = self.state("function", self._visit, outcomes=["more"])
        self.add("VISIT", visit, {"more": "VISIT"})

    def _visit(self, userdata):
        if self.visited:
            raise GivenUp("the pharmacist said no")
        self.visited = True
        return "more"


@pytest.mark.parametrize(
    ("machine", "outcome"), [(Prescribe, "given_up"), (Refuse, "not_begun"), (Round, "given_up")]
)
def test_a_state_that_gives_up_says_whether_anything_was_done(machine, outcome):
    made = machine()
    assert made.run_once({}) == ABORTED
    assert made.reason == "the pharmacist said no"
    assert given_up(made) == outcome


def test_a_state_names_on_what_account_it_gives_up():
    class NoPoint(Refuse):
        def _decide(self, userdata):
            raise GivenUp("there is no attic", about="attic")

    made = NoPoint()
    made.run_once({})
    assert given_up(made) and made.about == "attic"
    assert no_retry("navigate", ["hall", "Attic"], "attic") == "(navigate * Attic)"
    assert no_retry("navigate", ["hall", "attic"], "") == "(navigate hall attic)"
    assert no_retry("navigate", ["hall", "attic"], "box") == "(navigate hall attic)"


class Fails(Refuse):
    def _decide(self, userdata):
        raise ValueError("not yet")


def test_a_state_that_fails_does_not_give_up():
    made = Fails()
    assert made.run_once({}) == ABORTED and given_up(made) == ""


class TriesAnother(Fails):
    """Its first state gives up, and its last one fails for a reason that may pass."""

    why = ""

    def build(self):
        inner = MerlinSM(OUTCOMES)
        with inner:
            inner.add("READ", self.state("function", self._read))
        self.add("ASK", inner, {ABORTED: "DECIDE"})
        super().build()

    def _read(self, userdata):
        raise GivenUp(self.why, about="attic")


@pytest.mark.parametrize("why", ["", "not", "not yet"])
def test_a_state_that_gave_up_does_not_count_when_another_one_failed_last(why):
    made = TriesAnother()
    made.why = why
    assert made.run_once({}) == ABORTED and made.reason == "not yet"
    assert (given_up(made), made.about) == ("", "")


class Watch(MerlinState):
    """Watches until it is preempted."""

    def run(self, userdata):
        woken = threading.Event()
        self.interruptible(woken.set)
        assert woken.wait(LONG)
        self.interruptible(None)
        return "preempted"


@pytest.mark.parametrize("why", ["", "there is no attic"])
@pytest.mark.parametrize("inside", [MerlinSM, StateMachine, Concurrence, WhileSM])
def test_a_container_gives_up_with_the_state_that_decides(inside, why):
    def refuse(userdata):
        raise GivenUp(why, about="attic")

    class Contains(MerlinActionSM):
        def build(self):
            refuses = self.state("function", refuse)
            if inside is WhileSM:
                made = self.state("while", refuses, Watch(), "aborted")
            else:
                made = inside(OUTCOMES, *([ABORTED] if inside is Concurrence else []))
                with made:
                    inside.add("REFUSES", refuses)
            self.add("IN", made)

    made = Contains()
    assert made.run_once({}) == ABORTED and given_up(made) and made.about == "attic"
    made.prepare()
    assert given_up(made) == "", "the next run may end before it begins"
