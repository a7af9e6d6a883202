# SPDX-License-Identifier: Apache-2.0
"""Announces the services of one part of a node with one call of the master."""

import contextlib
import threading
import xmlrpc.client
from typing import Any, Iterator, List, Optional, Tuple

import rosgraph
from rospy.core import is_shutdown_requested, xmlrpcapi
from rospy.impl.registration import Registration, RegManager
from rospy.names import get_caller_id

from merlin_ros.master import master_link


class _Waiting(threading.local):
    """What the calling thread announces later: registration manager, service, its address; None: nothing."""

    services: Optional[List[Tuple[Any, str, str]]] = None


_waiting = _Waiting()
_reg_added = RegManager.reg_added


@contextlib.contextmanager
def announced_together() -> Iterator[None]:
    """Services that this thread makes meanwhile are announced at the end, all at once.

    A call to the master costs two changes of the process: on a busy machine 20 of them are most of a start.
    Nothing is announced when an exception leaves the block. May be nested: the outermost one announces.
    """
    if _waiting.services is not None:
        yield
        return
    waiting: List[Tuple[Any, str, str]] = []
    _waiting.services = waiting
    RegManager.reg_added = _added
    try:
        yield
    finally:
        _waiting.services = None
    _announce(waiting)


def _added(manager: Any, name: str, what: str, kind: str) -> None:
    """In the place of rospy's own, which asks the master at once."""
    if kind == Registration.SRV and _waiting.services is not None and manager.master_uri:
        _waiting.services.append((manager, name, what))
    else:
        _reg_added(manager, name, what, kind)


def _announce(services: List[Tuple[Any, str, str]]) -> None:
    if is_shutdown_requested():
        return
    refused = services
    if len(services) > 1:
        with contextlib.suppress(*master_link.ERRORS, ValueError, TypeError):
            calls = xmlrpc.client.MultiCall(xmlrpcapi(rosgraph.get_master_uri()))
            for manager, name, address in services:
                calls.registerService(get_caller_id(), name, address, manager.uri)
            answers: Any = calls()
            refused = [service for service, (code, _, _) in zip(services, answers) if code != 1]
    for manager, name, address in refused:  # one by one, and again and again, as rospy does it
        _reg_added(manager, name, address, Registration.SRV)
