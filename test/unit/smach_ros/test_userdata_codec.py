# SPDX-License-Identifier: Apache-2.0
"""Defect I3: userdata that comes by a topic is data, never code."""

import base64
import collections
import os
import pickle
import subprocess

import actionlib.msg
import pytest
import rospy
from geometry_msgs.msg import PoseStamped

from smach_ros.userdata_codec import UserDataError, decode, encode

PLAIN = {
    "none": None,
    "truth": True,
    "number": 3,
    "big": 2**70,
    "float": 2.5,
    "complex": 1 + 2j,
    "text": "größer",
    "bytes": bytes(range(256)),
    "no bytes": b"",
    "bytearray": bytearray(b"\x00\xff"),
    "list": [1, [2]],
    "tuple": (1, (2,)),
    "dict": {"a": {1: 2}},
    "set": {1, 2},
    "frozenset": frozenset("ab"),
}


class Reduced:
    def __init__(self, *how):
        self.how = how

    def __reduce__(self):
        return self.how


def packed(values, protocol=2):
    return base64.b64encode(pickle.dumps(values, protocol)).decode()


def test_plain_values_and_messages_come_back():
    pose = PoseStamped()
    pose.header.frame_id, pose.pose.position.x = "map", 1.5
    values = {
        **PLAIN,
        "pose": pose,
        "goals": [actionlib.msg.TestGoal(goal=1)],
        "time": rospy.Time(3, 4),
        "d": rospy.Duration(5),
    }
    assert decode(encode(values)) == values


def test_encoding_is_that_of_noetic():
    assert encode({}) == "gAJ9cQAu"
    assert pickle.loads(base64.b64decode(encode(PLAIN))) == PLAIN
    assert pickle.loads(base64.b64decode(encode({"g": actionlib.msg.TestGoal(goal=2)}))) == {
        "g": actionlib.msg.TestGoal(goal=2)
    }


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4])
def test_every_protocol_is_read(protocol):
    values = {"a": [1, "b", 2.5, None], "goal": actionlib.msg.TestGoal(goal=2), "set": {1}}
    assert decode(packed(values, protocol)) == values


@pytest.mark.parametrize(
    "evil",
    [
        (os.system, ("touch {path}",)),
        (subprocess.Popen, (["touch", "{path}"],)),
        (eval, ("open('{path}', 'w')",)),
        (exec, ("open('{path}', 'w')",)),
        (open, ("{path}", "w")),
        (getattr, ("", "upper")),
        (__import__, ("os",)),
        (collections.Counter, ("aa",)),
        (bytearray, (10**12,)),
        (bytes, (10**12,)),
    ],
    ids=lambda how: how[0].__name__,
)
def test_i3_no_code_is_run(tmp_path, evil):
    function, arguments = evil
    path = str(tmp_path / "owned")
    arguments = tuple(a.format(path=path) if isinstance(a, str) else a for a in arguments)
    if function is subprocess.Popen:
        arguments = (["touch", path],)
    with pytest.raises(UserDataError):
        decode(packed({"x": Reduced(function, arguments)}))
    assert not os.path.exists(path)


@pytest.mark.parametrize(
    "pickled",
    [
        b"cos\nsystem\n(S'true'\ntR.",
        b"c__builtin__\neval\n(S'1'\ntR.",
        b"cactionlib.msg\nrospy\n.",
        b"cactionlib.msg._TestGoal\nstruct\n.",
        b"crospy.msg\nAnyMsg\n.",
        b"csmach.State\n__init__\n.",
        b"c_codecs\nencode\n(S'x'\nS'zip'\ntR.",
        b"P1\n.",
    ],
)
def test_i3_other_names_are_refused(pickled):
    with pytest.raises(UserDataError):
        decode(base64.b64encode(pickled).decode())


@pytest.mark.parametrize("text", ["no base64!", "gAJ9", "ä", packed([1]), packed({1: 2}), packed("x")])
def test_what_is_no_userdata_is_refused_with_a_reason(text):
    with pytest.raises(UserDataError, match="local_data"):
        decode(text)


def test_empty_text_is_no_userdata():
    assert decode("") == {}


def test_i1_what_cannot_be_pickled_is_shown_as_text():
    class Local:
        def __repr__(self):
            return "a local thing"

    class Broken:
        def __repr__(self):
            raise ValueError

    values = pickle.loads(
        base64.b64decode(
            encode({"f": open, "l": Local(), "deep": [Local()], "b": Broken(), "t": int, "n": 1})
        )
    )
    assert values["l"] == "a local thing" and values["deep"] == ["a local thing"] and values["n"] == 1
    assert "Broken" in values["b"] and "int" in values["t"]
