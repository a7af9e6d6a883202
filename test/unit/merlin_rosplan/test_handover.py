"""Messages between components of one process."""

from unittest import mock

import pytest

from merlin_rosplan.handover import Handover


class Message:
    def __init__(self, text, caller):
        self.text = text
        self._connection_header = {"callerid": caller}


@pytest.fixture
def received():
    texts = []
    subscription = Handover.receiver("/topic", lambda message: texts.append(message.text))
    with mock.patch("rospy.get_name", return_value="/me"):
        yield texts, subscription
    subscription.shutdown()


def test_a_message_handed_over_is_not_received_from_the_topic_again(received):
    texts, subscription = received
    sender = Handover.sender("/topic")
    message = Message("a", "/me")
    sender.hand_over(message)
    subscription.from_topic(message)
    assert texts == ["a"]
    sender.shutdown()


def test_messages_of_other_nodes_come_by_topic(received):
    texts, subscription = received
    sender = Handover.sender("/topic")
    subscription.from_topic(Message("b", "/other"))
    assert texts == ["b"]
    sender.shutdown()


def test_without_a_sender_in_the_process_the_topic_is_all_there_is(received):
    texts, subscription = received
    Handover.sender("/topic").shutdown()
    subscription.from_topic(Message("c", "/me"))
    assert texts == ["c"]


def test_other_topics_and_ended_receivers_get_nothing(received):
    texts, subscription = received
    sender = Handover.sender("/elsewhere")
    sender.hand_over(Message("d", "/me"))
    sender.shutdown()
    subscription.shutdown()
    sender = Handover.sender("/topic")
    sender.hand_over(Message("e", "/me"))
    sender.shutdown()
    assert texts == []
