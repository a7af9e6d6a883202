# SPDX-License-Identifier: Apache-2.0
"""Service calls between components of one process."""

import threading
from types import SimpleNamespace
from unittest import mock

import pytest
import rospy
from rosplan_knowledge_msgs.srv import GetAttributeService, GetAttributeServiceResponse

from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_rosplan.transport import direct_service
from merlin_rosplan.transport.direct_service import DirectServiceProxy, offer


@pytest.fixture
def knowledge_base():
    """A service whose handler is a mock, and the event that ends it."""
    handler = mock.Mock(return_value=GetAttributeServiceResponse())
    service = SimpleNamespace(
        resolved_name="/kb/state/goals",
        handler=handler,
        request_class=GetAttributeService._request_class,
    )
    ended = threading.Event()
    with mock.patch("rospy.get_name", return_value="/me"), mock.patch.dict(direct_service._offers):
        offer(service, ended)
        yield handler, ended


def test_a_service_of_this_process_is_called_without_a_connection(knowledge_base):
    handler, _ = knowledge_base
    answer = DirectServiceProxy("/kb/state/goals", GetAttributeService)(predicate_name="at")
    (request,) = handler.call_args[0]
    assert answer is handler.return_value
    assert request.predicate_name == "at"
    assert request._connection_header == {"callerid": "/me"}


@pytest.mark.parametrize(
    "error", [rospy.ServiceException("no such predicate"), KeyError("no such predicate")]
)
def test_a_failure_is_reported_as_over_a_connection(knowledge_base, error):
    knowledge_base[0].side_effect = error
    with pytest.raises(ServiceError, match="/kb/state/goals failed: .*no such predicate"):
        DirectServiceProxy("/kb/state/goals", GetAttributeService)("")


@pytest.mark.parametrize("name, ends", [("/kb/state/goals", True), ("/other/state/goals", False)])
def test_any_other_service_is_called_over_its_connection(knowledge_base, name, ends):
    handler, ended = knowledge_base
    if ends:
        ended.set()
    with mock.patch.object(ServiceProxy, "__call__", return_value="answer") as call:
        assert DirectServiceProxy(name, GetAttributeService)("") == "answer"
    call.assert_called_once_with("")
    handler.assert_not_called()
