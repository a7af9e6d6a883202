# SPDX-License-Identifier: Apache-2.0
"""Userdata is shown without anything being run."""

import base64
import collections
import pickle
import pickletools
import tracemalloc
from typing import Any, Callable, Dict

import pytest
from geometry_msgs.msg import Point
from hypothesis import example, given
from hypothesis import strategies as st

from merlin_monitor.text.userdata_text import LONGEST_VALUE, UserDataTextError, userdata_rows

RAN = []


class Mine:
    """Runs code when it is unpickled, and when it is called."""

    def __reduce__(self) -> Any:
        return (_run, ("it",))


def _run(word: str) -> str:
    RAN.append(word)
    return word


def text_of(values: Any, protocol: int = 2) -> str:
    return base64.b64encode(pickle.dumps(values, protocol)).decode()


def rows(values: Dict[str, Any], protocol: int = 2) -> Dict[str, str]:
    return dict(userdata_rows(text_of(values, protocol)))


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_plain_values_read_as_they_are(protocol: int) -> None:
    shown = rows({"n": 3, "t": "it's", "l": [1, (2.5, None)], "d": {"a": True}, "b": b"\x00\xff"}, protocol)
    assert shown == {
        "n": "3",
        "t": '"it\'s"',
        "l": "[1, (2.5, None)]",
        "d": "{'a': True}",
        "b": "b'\\x00\\xff'",
    }
    assert rows({"s": {4}}, protocol)["s"] == "set{4}"


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_nothing_is_run(protocol: int) -> None:
    shown = rows({"evil": Mine(), "good": 1}, protocol)
    assert RAN == []
    assert "_run" in shown["evil"] and "'it'" in shown["evil"]
    assert shown["good"] == "1"


def test_messages_are_shown_by_name_and_content() -> None:
    assert rows({"where": Point(1.0, 2.0, 0.0)})["where"] == "geometry_msgs/Point[1.0, 2.0, 0.0]"


class Names(list):
    """A list of the application's own."""


def test_containers_of_all_kinds_are_shown() -> None:
    """They are named, and what they hold is shown; nothing of them is made."""
    shown = rows(
        {
            "ordered": collections.OrderedDict(a=1),
            "names": Names(["b"]),
            "raw": bytearray(b"c"),
            "frozen": frozenset(["d"]),
            "keyed": {("e", 1): 2},
            "kind": Names,
        },
        pickle.HIGHEST_PROTOCOL,
    )
    assert shown["ordered"] == "collections.OrderedDict{'a': 1}"
    assert shown["names"].endswith("Names('b')") and shown["kind"].endswith("Names")
    assert (shown["raw"], shown["frozen"]) == ("b'c'", "frozenset{'d'}")
    assert shown["keyed"] == "{\"('e', 1)\": 2}"


def assert_harmless(text: str) -> None:
    """Whatever it is, it is refused or short, runs nothing, and leaves the next userdata alone."""
    try:
        shown = userdata_rows(text)
    except UserDataTextError:
        shown = []
    assert all(len(key) <= 100 and len(value) <= LONGEST_VALUE + 20 for key, value in shown)
    assert RAN == []
    assert rows({"a": Mine()}, 2)["a"].endswith("_run('it')")


def nested_key() -> bytes:
    """A dict whose key shares its parts: hashing it takes 2 ** 60 steps."""
    program = b"N"
    for number in range(60):
        program += b"q" + bytes([number]) + b"h" + bytes([number]) + b"\x86"
    return b"\x80\x02}(" + program + b"K\x01u."


def announced() -> bytes:
    """A bytearray of half the address space."""
    return b"\x80\x05}\x8c\x01a\x96" + (2**62).to_bytes(8, "little") + b"s."


@pytest.mark.parametrize("make", [nested_key, announced])
def test_what_is_small_and_claims_to_be_huge_costs_nothing(make: Callable[[], bytes]) -> None:
    """No memory; time without end would be this test's."""
    text = base64.b64encode(make()).decode()
    tracemalloc.start()
    try:
        assert_harmless(text)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1 << 20


def test_older_smach_sends_the_pickle_itself() -> None:
    raw = pickle.dumps({"a": 1}, 2).decode("latin-1")
    assert userdata_rows(raw) == [("a", "1")]
    assert userdata_rows("") == []


def test_parts_that_nest_without_end_stay_short() -> None:
    bomb: Any = ["lol"]
    for _ in range(60):
        bomb = [bomb, bomb]
    loop: list = []
    loop.append(loop)
    shown = rows({"bomb": bomb, "loop": loop, "long": "x" * 100_000, "big": 1 << 5000})
    assert all(len(value) <= LONGEST_VALUE + 20 for value in shown.values()), shown


@pytest.mark.parametrize(
    "text", ["hello", "====", base64.b64encode(b"\x80\x02K\x01.").decode(), "gAJ9cQA", "A" * 1_000_000]
)
def test_what_is_no_userdata_says_so(text: str) -> None:
    with pytest.raises(UserDataTextError):
        userdata_rows(text)


@given(st.binary(max_size=60))
def test_random_bytes_do_no_harm(data: bytes) -> None:
    assert_harmless(base64.b64encode(data).decode())


OPCODES = [opcode.code.encode("latin-1") for opcode in pickletools.opcodes]
CALLS = f"c{__name__}\n_run\n(U\x02ittR0".encode()


@given(st.lists(st.sampled_from([*OPCODES, CALLS]), max_size=20), st.binary(max_size=8))
@example([CALLS], b"")
def test_random_programs_do_no_harm(opcodes: list, data: bytes) -> None:
    program = b"\x80\x02}" + data.join(opcodes) + b"."
    assert_harmless(base64.b64encode(program).decode())
