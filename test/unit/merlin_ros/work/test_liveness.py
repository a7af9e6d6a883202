# SPDX-License-Identifier: Apache-2.0
"""Which peers live: words and passing time in, what is believed of them out."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_ros.alarms import LONGEST_TICK, TickClock
from merlin_ros.work.liveness import KEEP_LIVES, SLOWEST, Limits, Liveness, Presence, Word

LIMITS = Limits(gone=3.0, silent=0.6, closed=0.9)


def peers(limits=LIMITS, room=1000):
    return Liveness(limits, room)


def test_what_was_never_heard_is_unknown():
    book = peers()
    book.left("/a")
    assert book.presence("/a") is Presence.UNKNOWN and "/a" not in book and list(book) == []
    assert book.age("/a") == math.inf
    with pytest.raises(KeyError):
        book.silence("/a")


def test_silence_makes_a_peer_silent_and_then_gone_and_a_word_brings_it_back():
    book = peers()
    assert book.heard("/a", "one") is Word.COUNTS and book.presence("/a") is Presence.ALIVE
    book.pass_time(0.6)
    assert book.presence("/a") is Presence.ALIVE
    book.pass_time(0.1)
    assert book.presence("/a") is Presence.SILENT
    book.pass_time(2.4)
    assert book.presence("/a") is Presence.GONE and book.silence("/a") == pytest.approx(3.1)
    assert book.heard("/a", "one") is Word.COUNTS, "the same process may come back"
    assert book.presence("/a") is Presence.ALIVE and book.age("/a") == 0.0


def test_a_closed_connection_shortens_the_wait_and_is_no_verdict_by_itself():
    book = peers()
    book.heard("/a")
    assert book.presence("/a", connected=False) is Presence.ALIVE
    book.pass_time(0.95)
    assert book.presence("/a", connected=False) is Presence.GONE
    assert book.presence("/a", connected=True) is Presence.SILENT


def test_another_life_takes_the_place_of_the_one_before_whose_late_words_do_not_count():
    book = peers()
    book.heard("/a", "one")
    book.pass_time(1.0)
    assert book.heard("/a", "two") is Word.REBORN and book.age("/a") == 0.0
    book.pass_time(1.0)
    assert book.heard("/a", "one") is Word.IGNORED
    assert book.silence("/a") == 1.0, "a late word is not a sign of life"
    assert book.heard("/a", "two") is Word.COUNTS


def test_the_life_that_comes_after_a_peer_is_gone_ends_the_one_before():
    book = peers()
    book.heard("/a", "one")
    book.pass_time(10.0)
    assert book.heard("/a", "two") is Word.REBORN and book.heard("/a", "one") is Word.IGNORED


def test_a_peer_that_left_comes_back_with_another_life_only():
    book = peers()
    book.heard("/a", "one")
    book.left("/a")
    assert book.presence("/a") is Presence.LEFT
    assert book.heard("/a", "one") is Word.IGNORED and book.presence("/a") is Presence.LEFT
    assert book.heard("/a", "two") is Word.COUNTS and book.presence("/a") is Presence.ALIVE


def test_a_peer_that_names_no_life_may_leave_and_come_back():
    book = peers()
    book.heard("/a")
    book.left("/a")
    assert book.heard("/a") is Word.COUNTS and book.presence("/a") is Presence.ALIVE


def test_lives_that_are_over_do_not_grow_without_end():
    book = peers()
    for number in range(KEEP_LIVES + 2):
        book.heard("/a", str(number))
    assert book.heard("/a", "1") is Word.IGNORED
    assert book.heard("/a", "0") is Word.REBORN, "it was over for so long that it is forgotten"


def test_the_silence_of_an_expected_peer_begins_when_it_is_expected():
    book = peers()
    book.expect("/a")
    assert book.presence("/a") is Presence.ALIVE
    book.pass_time(5.0)
    assert book.presence("/a") is Presence.GONE
    book.expect("/a")
    assert book.presence("/a") is Presence.ALIVE
    assert book.heard("/a", "one") is Word.COUNTS and book.heard("/a", "two") is Word.REBORN


def test_the_watchers_own_stall_is_nobodys_silence():
    time = [0.0]
    ticks, book = TickClock(lambda: time[0]), peers()
    book.heard("/a")
    time[0] += 3600.0  # SIGSTOP
    book.pass_time(ticks.look())
    assert book.silence("/a") == LONGEST_TICK and book.presence("/a") is Presence.ALIVE


def test_a_stall_counts_once_what_came_meanwhile_has_been_read():
    book = peers(Limits(gone=5.0, settle=0.9))
    book.heard("/lives")
    book.heard("/died")
    book.pass_time(60.0, stalled=True)
    assert book.presence("/lives") is book.presence("/died") is Presence.ALIVE
    book.heard("/lives")
    book.pass_time(1.0)
    assert book.presence("/lives") is Presence.ALIVE and book.silence("/lives") == 1.0
    assert book.presence("/died") is Presence.GONE and book.silence("/died") == 61.0


def test_stalls_that_follow_each_other_are_settled_together():
    book = peers(Limits(gone=5.0, settle=0.9))
    book.heard("/lives")
    book.pass_time(60.0, stalled=True)
    book.pass_time(0.5, stalled=True)
    assert book.silence("/lives") == 0.0
    book.pass_time(1.0)
    assert book.silence("/lives") == 61.5
    book.pass_time(7.0, stalled=True)
    assert book.silence("/lives") == 61.5, "the first stall counts by now"


def test_a_peer_that_speaks_slowly_is_given_proportionally_more():
    book = peers(Limits(gone=5.0, period=1.0))
    book.heard("/slow")
    book.pass_time(4.0)
    book.heard("/slow")
    book.pass_time(20.0)
    assert book.silence("/slow") == 5.0 and book.presence("/slow") is Presence.ALIVE
    book.pass_time(500.0)
    book.heard("/slow")
    book.pass_time(5.0 * SLOWEST)
    assert book.presence("/slow") is Presence.ALIVE
    book.pass_time(1.0)
    assert book.presence("/slow") is Presence.GONE, "nobody may take more than ten times as long"


def test_a_peer_is_there_since_its_first_word_after_an_absence():
    book = peers()
    book.heard("/a")
    for _ in range(4):
        book.pass_time(1.0)
        book.heard("/a")
    assert book.age("/a") == 4.0
    book.pass_time(3.5)
    book.heard("/a")
    assert book.age("/a") == 0.0


def test_names_without_end_push_out_none_that_is_heard():
    book = peers(Limits(gone=3.0, keep=60.0), room=3)
    book.heard("/a")
    assert [book.heard(f"/ghost{number}") for number in range(9)].count(Word.IGNORED) == 7
    book.pass_time(60.0)
    book.heard("/a")
    book.expect("/b")
    assert "/b" not in book
    book.pass_time(1.0)
    assert book.heard("/b") is Word.COUNTS and list(book) == ["/ghost1", "/a", "/b"]


def test_a_node_that_names_peers_without_end_costs_no_other_node_a_peer():
    forgotten = []
    book = Liveness(Limits(gone=3.0, keep=10.0), 4, 2, forgotten.append)
    book.heard("a", source="/a")
    words = [book.heard(f"ghost{number}", source="/flood") for number in range(4)]
    assert words == [Word.COUNTS] * 2 + [Word.IGNORED] * 2
    assert book.crowded("/flood") and not book.crowded("/a")
    assert book.heard("b", source="/b") is Word.COUNTS
    assert book.heard("c", source="/c") is Word.IGNORED, "all of them are too many"
    book.pass_time(5.0)
    book.heard("ghost0", source="/flood")
    book.pass_time(6.0)
    assert book.heard("ghost9", source="/flood") is Word.COUNTS and forgotten == ["ghost1"]
    assert book.heard("c", source="/c") is Word.COUNTS and forgotten == ["ghost1", "a"]
    book.pass_time(11.0)
    assert [book.heard(each, source="/d") for each in "de"] == [Word.COUNTS] * 2
    assert forgotten[2:] == ["b", "ghost0"] and not book.crowded("/flood")


def test_what_has_left_makes_room_first():
    book = peers(Limits(gone=3.0, keep=60.0), room=2)
    book.heard("/a", "one")
    book.heard("/b", "one")
    book.left("/b")
    assert book.heard("/c") is Word.COUNTS and list(book) == ["/a", "/c"]


@pytest.mark.parametrize("last", [Liveness.heard, Liveness.expect])
def test_without_a_time_to_keep_the_one_that_is_silent_for_longest_makes_room(last):
    book = peers(room=2)
    book.heard("/a")
    book.heard("/b")
    last(book, "/a")
    book.heard("/c")
    assert list(book) == ["/a", "/c"]


_keys, _lives = st.sampled_from("abcd"), st.sampled_from(["", "1", "2", "3"])
_events = st.one_of(
    st.tuples(st.just("heard"), _keys, _lives),
    st.tuples(st.sampled_from(["left", "expect"]), _keys),
    st.tuples(st.just("pass_time"), st.floats(0.0, 5.0), st.booleans()),
)


@given(st.lists(_events, max_size=60), st.floats(0.0, 4.0))
def test_whatever_happens_a_word_that_counts_makes_its_peer_alive_and_silence_only_grows(events, keep):
    forgotten = set()
    book = Liveness(Limits(3.0, 0.6, 0.9, keep, period=1.0, settle=0.5), 3, on_forget=forgotten.add)
    for name, *arguments in events:
        before = {key: book.presence(key) for key in "abcd"}
        forgotten.clear()
        word = getattr(book, name)(*arguments)
        assert len(list(book)) <= 3 and forgotten.isdisjoint(book)
        for key in "abcd":
            presence, closed = book.presence(key), book.presence(key, connected=False)
            assert (presence is Presence.UNKNOWN) == (key not in book)
            assert closed is presence or closed is Presence.GONE
            if name == "pass_time" and before[key] is Presence.LEFT:
                assert presence is Presence.LEFT
        if name == "heard":
            key, _ = arguments
            assert book.presence(key) is (before[key] if word is Word.IGNORED else Presence.ALIVE)
            assert word is not Word.REBORN or before[key] not in (Presence.UNKNOWN, Presence.LEFT)
