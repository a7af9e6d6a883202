# SPDX-License-Identifier: Apache-2.0
"""Announces the services and topics of one part of a node with one call of the master, once they are made."""

import contextlib
import functools
import threading
import xmlrpc.client
from typing import Any, Iterator, List, NamedTuple, Optional

import rosgraph
import rospy
from rospy.core import is_shutdown_requested, xmlrpcapi
from rospy.impl.registration import Registration, RegManager
from rospy.names import get_caller_id

from merlin_ros.master import master_link

_METHODS = {
    Registration.PUB: "registerPublisher",
    Registration.SUB: "registerSubscriber",
    Registration.SRV: "registerService",
}


class _Waits(NamedTuple):
    """What is announced later, as rospy names it."""

    manager: Any
    name: str
    what: str
    """Type of a topic, address of a service."""
    kind: str


class _Waiting(threading.local):
    """What the calling thread announces later; None: nothing."""

    things: Optional[List[_Waits]] = None


_waiting = _Waiting()
_reg_added = RegManager.reg_added


@contextlib.contextmanager
def announced_together() -> Iterator[None]:
    """Services and topics that this thread makes meanwhile are announced at the end, all at once.

    A call to the master costs two changes of the process: on a busy machine 20 of them are most of a start.
    Nothing is announced when an exception leaves the block. May be nested: the outermost one announces.
    """
    if _waiting.things is not None:
        yield
        return
    waiting: List[_Waits] = []
    _waiting.things = waiting
    RegManager.reg_added = _added
    try:
        yield
    finally:
        _waiting.things = None
    _announce(waiting)


def announce_complete() -> None:
    """From now on a topic is announced when its publisher or subscriber is made; may be called again.

    rospy announces it before it sets queue, latch, listener and callback. A node that connects meanwhile gets
    no latched message, and is waited for with each message when it hangs; what a publisher has latched comes
    before there is a callback.
    """
    for kind in (rospy.Publisher, rospy.Subscriber):
        if not hasattr(kind.__init__, "__wrapped__"):
            kind.__init__ = _complete(kind.__init__)


def _complete(make: Any) -> Any:
    @functools.wraps(make)
    def make_and_announce(topic: Any, *args: Any, **options: Any) -> None:
        with announced_together():
            make(topic, *args, **options)

    return make_and_announce


def _added(manager: Any, name: str, what: str, kind: str) -> None:
    """In the place of rospy's own, which asks the master at once."""
    if _waiting.things is not None and manager.master_uri:
        _waiting.things.append(_Waits(manager, name, what, kind))
    else:
        _reg_added(manager, name, what, kind)


def _announce(things: List[_Waits]) -> None:
    if is_shutdown_requested():
        return
    refused = things
    if len(things) > 1:
        with contextlib.suppress(*master_link.ERRORS, ValueError, TypeError):
            calls: Any = xmlrpc.client.MultiCall(xmlrpcapi(rosgraph.get_master_uri()))
            for manager, name, what, kind in things:
                getattr(calls, _METHODS[kind])(get_caller_id(), name, what, manager.uri)
            answers = list(calls())
            refused = [thing for thing, (code, _, _) in zip(things, answers) if code != 1]
            for (manager, name, _, kind), (code, _, value) in zip(things, answers):
                if kind == Registration.SUB and code == 1:
                    manager.publisher_update(name, value)
    for manager, name, what, kind in refused:  # one by one, and again and again, as rospy does it
        _reg_added(manager, name, what, kind)
