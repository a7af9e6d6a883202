# SPDX-License-Identifier: Apache-2.0
"""A connection counts while both sides have it open, whatever rospy still lists."""

import socket
from types import SimpleNamespace
from typing import Any, Iterator, Tuple

import pytest

from merlin_ros.actions.peers import came_over_open, connected_peers, link_from, reaches, sender_of

Pair = Tuple[socket.socket, socket.socket]


@pytest.fixture
def pair() -> Iterator[Pair]:
    ours, theirs = socket.socketpair()
    yield ours, theirs
    ours.close()
    theirs.close()


def topic(*links: Any) -> Any:
    return SimpleNamespace(impl=SimpleNamespace(connections=list(links)))


def link(ours: Any, node: str) -> Any:
    return SimpleNamespace(socket=ours, callerid_pub=node, endpoint_id=node, header={"callerid": node})


@pytest.mark.parametrize("side", ["ours", "theirs", "rospy has taken it away"])
def test_a_connection_that_either_side_has_closed_does_not_count(pair: Pair, side: str) -> None:
    ours, theirs = pair
    ann, bob = link(ours, "/ann"), link(None, "/bob")
    both = topic(ann, bob)
    assert connected_peers(both) == {"/ann"}
    assert link_from(both, "/ann") is ann and link_from(both, "/bob") is None
    assert reaches(both, "/ann") and not reaches(both, "/bob") and not reaches(both, "/eve")
    assert came_over_open(both, ann.header)
    if side == "ours":
        ours.close()
    elif side == "theirs":
        theirs.close()
    else:
        ann.socket = None
    assert connected_peers(both) == set() and link_from(both, "/ann") is None
    assert not reaches(both, "/ann") and not came_over_open(both, ann.header)


def test_a_message_of_a_connection_before_did_not_come_over_this_one(pair: Pair) -> None:
    ann = topic(link(pair[0], "/ann"))
    assert not came_over_open(ann, {"callerid": "/ann"})
    assert not came_over_open(ann, None)
    assert connected_peers(SimpleNamespace(impl=None)) == set(), "the topic was shut down"


def test_the_sender_is_known_where_a_message_has_come_from_another_process() -> None:
    assert sender_of(SimpleNamespace(_connection_header={"callerid": "/ann"})) == "/ann"
    assert sender_of(SimpleNamespace(_connection_header=None)) == sender_of(object()) == ""
