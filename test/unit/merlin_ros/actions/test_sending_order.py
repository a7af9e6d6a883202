# SPDX-License-Identifier: Apache-2.0
"""Stamps are placed in the order of their sending, also over a clock that is set."""

from merlin_ros.actions.sending_order import SendingOrder


def test_before_the_first_look_a_stamp_is_where_it_says() -> None:
    order = SendingOrder()
    assert order.place(70) == order.sent(70) == 70
    assert order.look(100) == 0
    assert order.place(100) == 100


def test_what_is_stamped_ahead_of_the_clock_was_sent_now() -> None:
    order = SendingOrder()
    order.look(100)
    assert (order.place(90), order.sent(90)) == (90, 90)
    assert (order.place(130), order.sent(130)) == (130, 100)
    assert order.look(120) == 20
    assert (order.place(130), order.sent(130)) == (130, 120)


def test_after_a_step_back_of_the_clock_what_is_stamped_comes_later() -> None:
    order = SendingOrder()
    order.look(100)
    before = order.place(100)
    assert order.look(40) == 1
    assert order.place(40) == before + 1
    assert order.look(45) == 5
    assert order.place(45) == order.sent(45) == before + 6
    assert order.place(40) == before + 1
