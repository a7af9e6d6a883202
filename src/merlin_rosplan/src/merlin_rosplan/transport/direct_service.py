# SPDX-License-Identifier: Apache-2.0
"""Service calls between components of one process, without sockets.

A call through the loopback costs half a millisecond and two changes of thread; the dispatcher makes one for
each step of a plan.
"""

import threading
from typing import Any, Dict, NamedTuple, Optional

import rospy
from rospy.msg import args_kwds_to_message

from merlin_ros.ports.service_server import Unanswered
from merlin_ros.service_proxy import ServiceError, ServiceProxy, ServiceUnavailable


class _Offer(NamedTuple):
    service: rospy.Service
    ended: threading.Event


_offers: Dict[str, _Offer] = {}  # resolved name -> the service that this process offers


def offer(service: rospy.Service, ended: threading.Event) -> None:
    """Offers a service to this process without a connection.

    :param service: registered with the master already.
    :param ended: set when it is offered no more.
    """
    _offers[service.resolved_name] = _Offer(service, ended)


class DirectServiceProxy(ServiceProxy):
    """Calls the service in the calling thread where this process offers it, and else over its connection.

    The response of a direct call is the object that the service has made: read it, do not change it.
    """

    def __call__(self, *args: Any, **fields: Any) -> Any:
        """Calls the service with a request, or with the request's fields.

        :raises ServiceError: when there is no answer, or the service failed.
        """
        service = self._here()
        if service is None:
            return super().__call__(*args, **fields)
        request = args_kwds_to_message(service.request_class, args, fields)
        request._connection_header = {"callerid": rospy.get_name()}
        try:
            return service.handler(request)
        except Unanswered:
            raise ServiceUnavailable(f"service {self.name} does not answer: it ends") from None
        except Exception as error:  # as over a connection: whatever it is, the call has failed
            raise ServiceError(f"service {self.name} failed: {error}") from error

    def offered(self) -> bool:
        """See :meth:`ServiceProxy.offered`; the master is not asked for a service of this process."""
        return self._here() is not None or super().offered()

    def _here(self) -> Optional[rospy.Service]:
        found = _offers.get(self.name)
        return None if found is None or found.ended.is_set() else found.service
