# SPDX-License-Identifier: Apache-2.0
"""What viewers get of containers whose labels and outcomes are not texts, and of an Iterator."""

import enum
import io

import pytest
import rospy

import smach
from smach_ros import userdata_codec
from smach_ros.container_proxy import ContainerProxy


class Text(str, enum.Enum):
    ONE, TWO, OK = "ONE", "TWO", "ok"


class Plain(enum.Enum):
    ONE, TWO, OK = 1, 2, 3


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    monkeypatch.setattr(rospy.Time, "now", lambda: rospy.Time(1))


def proxy(container):
    return ContainerProxy("/SM", container)


def sent(message):
    """A message as its receiver reads it."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return type(message)().deserialize(buffer.getvalue())


@pytest.mark.parametrize(
    "one, two, ok, texts",
    [
        (*Text, ["ONE", "TWO", "ok"]),
        (*Plain, ["Plain.ONE", "Plain.TWO", "Plain.OK"]),
        (0, 1, True, ["0", "1", "True"]),
        ("", "B", "", ["", "B", ""]),
    ],
    ids=["texts", "members", "numbers", "empty"],
)
def test_messages_carry_texts(one, two, ok, texts):
    sm = smach.StateMachine([ok])
    with sm:
        smach.StateMachine.add(one, smach.State([ok]), {ok: two})
        smach.StateMachine.add(two, smach.State([ok]))
    sm.userdata[one] = 5
    shown = proxy(sm)
    structure, status = sent(shown.structure()), sent(shown.status([one], "INFO"))
    assert structure.children == texts[:2]
    assert structure.internal_outcomes == [texts[2]] * 2
    assert structure.outcomes_from == texts[:2] and structure.outcomes_to == [texts[1], "None"]
    assert structure.container_outcomes == [texts[2]]
    assert status.initial_states == status.active_states == [texts[0]]
    assert userdata_codec.decode(status.local_data) == {texts[0]: 5}
    shown.initialise([texts[1]], {})
    assert sm.get_initial_states() == [two]
    with pytest.raises(smach.InvalidStateError, match="NOWHERE"):
        shown.initialise(["NOWHERE"], {})


def test_a_machine_that_does_not_run_has_the_active_state_none():
    sm = smach.StateMachine(["done"])
    with sm:
        smach.StateMachine.add("A", smach.State(["done"]))
    assert sent(proxy(sm).status(None, "")).active_states == ["None"]


def test_n1_breaks_of_an_iterator_lead_to_its_outcomes_and_exhaustion_has_an_edge():
    loop = smach.Iterator(["found", "preempted"], [], [], it=[1], exhausted_outcome="nothing")
    with loop:
        smach.Iterator.set_contained_state(
            "LOOK", smach.State(["yes", "no", "preempted"]), ["no"], ["yes"], {"yes": "found"}
        )
    structure = sent(proxy(loop).structure())
    edges = list(zip(structure.internal_outcomes, structure.outcomes_from, structure.outcomes_to))
    assert edges == [
        ("yes", "LOOK", "found"),
        ("no", "LOOK", "LOOK"),
        ("preempted", "LOOK", "preempted"),
        ("nothing", "LOOK", "nothing"),
    ]
