# SPDX-License-Identifier: Apache-2.0
"""The shaper of the link: loss and delay."""

from chaos.under_test.link import Shaper
from hypothesis import given
from hypothesis import strategies as st


@given(st.lists(st.binary(max_size=20), max_size=30))
def test_a_healthy_link_keeps_packets_and_their_order(packets: list) -> None:
    shaper = Shaper()
    for packet in packets:
        shaper.put(packet, 1, 5.0)
    assert shaper.due(5.0) == [(1, packet) for packet in packets]
    assert shaper.due(9.0) == []


def test_a_slow_link_delivers_later() -> None:
    shaper = Shaper()
    shaper.delay = 0.3
    shaper.put(b"a", 1, 10.0)
    assert shaper.due(10.2) == []
    assert abs(shaper.wait(10.2) - 0.1) < 1e-6
    assert shaper.due(10.31) == [(1, b"a")]


def test_a_cut_link_loses_everything_that_is_under_way_too() -> None:
    shaper = Shaper()
    shaper.delay = 0.3
    shaper.put(b"a", 1, 10.0)
    shaper.loss = 1.0
    shaper.put(b"b", 1, 10.1)
    assert shaper.due(11.0) == []
    shaper.loss = 0.0
    assert shaper.due(12.0) == []


def test_a_lossy_link_loses_its_share() -> None:
    shaper = Shaper(seed=3)
    shaper.loss = 0.2
    for number in range(1000):
        shaper.put(str(number).encode(), 1, 0.0)
    assert 740 < len(shaper.due(0.0)) < 860
