# SPDX-License-Identifier: Apache-2.0
"""Messages between components of one process."""

import threading
from unittest import mock

import pytest
from std_msgs.msg import String
from std_srvs.srv import TriggerRequest

from merlin_rosplan.transport import handover
from merlin_rosplan.transport.handover import Handover, Subscription


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


def test_a_receiver_that_is_made_later_gets_what_was_handed_over_before(received):
    texts, _ = received
    sender = Handover.sender("/later")
    sender.hand_over(Message("old", "/me"))
    sender.hand_over(Message("new", "/me"))
    later = Handover.receiver("/later", lambda message: texts.append(message.text))
    assert texts == ["new"]
    later.shutdown()
    sender.shutdown()
    Handover.receiver("/later", lambda message: texts.append(message.text)).shutdown()
    assert texts == ["new"]


def test_a_message_that_comes_while_a_receiver_is_made_is_its_last_one(received, monkeypatch):
    texts, _ = received
    sender = Handover.sender("/meanwhile")
    sender.hand_over(Message("old", "/me"))
    messages, from_sender = [Message("new", "/me")], Subscription.from_sender

    def after_the_next(subscription, handed):
        while messages:
            sender.hand_over(messages.pop())
        from_sender(subscription, handed)

    monkeypatch.setattr(Subscription, "from_sender", after_the_next)
    late = Handover.receiver("/meanwhile", lambda message: texts.append(message.text))
    assert texts[-1] == "new"
    late.shutdown()
    sender.shutdown()


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


@pytest.fixture
def found():
    """The master that is asked where the sender is."""
    return mock.Mock()


@pytest.fixture
def in_another_process(monkeypatch, found):
    """A receiver whose sender can only be asked; returns it, its texts and the sender."""
    sender = handover.Sender("/topic of another process")
    monkeypatch.setattr(handover, "bounded_master", lambda limit: found)
    found.proxy = proxy = mock.Mock(
        side_effect=lambda: sender.answer_digest(TriggerRequest()), connected=False
    )
    monkeypatch.setattr(handover, "ServiceProxy", lambda *_, **__: proxy)
    monkeypatch.setattr("rospy.get_name", lambda: "/me")
    texts = []
    subscription = Handover.receiver("/topic", lambda message: texts.append(message.data))
    yield subscription, texts, sender
    subscription.shutdown()
    sender.shutdown()


def sent(text):
    message = String(text)
    message._connection_header = {"callerid": "/other"}
    return message


def test_what_another_process_has_sent_is_waited_for(in_another_process, monkeypatch):
    monkeypatch.setattr(handover, "IN_FLIGHT", 60.0)
    subscription, texts, sender = in_another_process
    subscription.from_topic(sent("old"))
    sender.hand_over(String("new"))
    late = threading.Timer(0.05, subscription.from_topic, [sent("new")])
    late.start()
    subscription.catch_up()
    assert texts == ["old", "new"]
    late.join()


def test_what_is_there_or_is_lost_is_not_waited_for(in_another_process, monkeypatch):
    subscription, texts, sender = in_another_process
    subscription.catch_up()
    sender.hand_over(String("a"))
    subscription.from_topic(sent("a"))
    subscription.from_topic(sent("by hand"))
    subscription.catch_up()
    monkeypatch.setattr(handover, "IN_FLIGHT", 0.01)
    sender.hand_over(String("lost"))
    subscription.catch_up()
    monkeypatch.setattr(handover, "IN_FLIGHT", 1e6)  # a second wait would not end
    subscription.catch_up()
    assert texts == ["a", "by hand"]


def test_a_sender_that_is_connected_is_not_looked_up_again(in_another_process, found):
    subscription, _, sender = in_another_process
    subscription.catch_up()
    found.proxy.connected = True
    subscription.catch_up()
    assert found.lookupService.call_count == 1
    found.proxy.connected = False
    subscription.catch_up()
    assert found.lookupService.call_count == 2 and found.proxy.call_count == 3
