# SPDX-License-Identifier: Apache-2.0
"""Clients that connect all at once, that say nothing, nonsense or too much."""

import contextlib
import io
import os
import random
import signal
import socket
import struct
import unittest
import xmlrpc.client

import rosgraph
import rospy
from diagnostic_msgs.msg import KeyValue
from rosgraph.names import ns_join
from rosgraph.network import write_ros_handshake_header
from rosgraph_msgs.msg import Log
from rosplan_knowledge_msgs.msg import KnowledgeItem
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    GetDomainNameService,
    GetDomainOperatorDetailsService,
    KnowledgeQueryService,
    KnowledgeUpdateService,
    KnowledgeUpdateServiceArray,
)
from std_srvs.srv import Trigger

from merlin_test import LONG
from merlin_test.process_signals import hang
from merlin_test.topic_links import wait_for_publisher

KB = "/robot/rosplan_knowledge_base"


def fact(name, *args):
    values = [KeyValue(str(number), arg) for number, arg in enumerate(args)]
    return KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name=name, values=values)


def expression(text):
    return KnowledgeItem(knowledge_type=KnowledgeItem.EXPRESSION, attribute_name=text)


def call(name, kind, *args):
    return rospy.ServiceProxy(ns_join(KB, name), kind)(*args)


def address(service):
    host, port = rosgraph.Master(rospy.get_name()).lookupService(ns_join(KB, service))[9:].split(":")
    return host.strip("/"), int(port)


def connect(service, kind):
    """A connection that has been greeted."""
    connection = socket.create_connection(address(service), LONG)
    header = {"service": ns_join(KB, service), "md5sum": kind._md5sum, "callerid": "/fuzz", "persistent": "1"}
    write_ros_handshake_header(connection, header)
    (length,) = struct.unpack("<I", connection.recv(4, socket.MSG_WAITALL))
    connection.recv(length, socket.MSG_WAITALL)
    return connection


def body(request):
    buffer = io.BytesIO()
    request.serialize(buffer)
    return buffer.getvalue()


class KnowledgeTransportTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.wait_for_service(ns_join(KB, "apply_effects"), LONG)

    def answered_or_closed(self, connection, text):
        """What came back; a time-out is an error."""
        connection.sendall(text)
        first = connection.recv(5, socket.MSG_WAITALL)
        if len(first) < 5:
            return b""
        return first + connection.recv(struct.unpack("<I", first[1:])[0], socket.MSG_WAITALL)

    def test_every_request_is_answered_or_its_connection_closed(self):
        chance = random.Random(18)
        requests = {
            ("update", KnowledgeUpdateService): (0, fact("checked", "kitchen")),
            ("update_array", KnowledgeUpdateServiceArray): ([0, 2], [fact("checked", "hall")] * 2),
            ("query_state", KnowledgeQueryService): ([fact("robot_at", ""), fact("checked", "hall")],),
            ("state/propositions", GetAttributeService): ("checked",),
        }
        for (service, kind), args in requests.items():
            good = body(kind._request_class(*args))
            for _ in range(40):
                bad = bytearray(good)
                for _ in range(chance.randint(1, 4)):
                    bad[chance.randrange(len(bad))] = chance.choice((0, 1, 0x7F, 0x80, 0xFF))
                del bad[chance.randint(0, len(bad)) :]
                with connect(service, kind) as connection:
                    self.answered_or_closed(connection, struct.pack("<I", len(bad)) + bytes(bad))
        for text in (struct.pack("<I", 0xFFFFFFFF), struct.pack("<I", 9) + b"half", b"\1"):
            with connect("update", KnowledgeUpdateService) as connection:
                self.assertIn(self.answered_or_closed(connection, text)[:1], (b"", b"\0"), text)
        self.assertEqual(call("domain/name", GetDomainNameService).domain_name, "home")

    def test_a_client_that_says_nothing_keeps_no_other_waiting(self):
        with socket.create_connection(address("domain/name"), LONG) as silent:
            self.assertEqual(call("domain/name", GetDomainNameService).domain_name, "home")
            silent.settimeout(LONG)
            self.assertEqual(silent.recv(1), b"", "the silent connection is closed in the end")

    def test_clients_that_connect_at_once_need_not_knock_twice(self):
        uri = rosgraph.Master(rospy.get_name()).lookupNode(KB)
        pid = xmlrpc.client.ServerProxy(uri).getPid(rospy.get_name())[2]
        waiting = []
        hang(pid)
        try:  # what is not let in at once comes again after a second
            waiting.extend(socket.create_connection(address("domain/name"), 0.9) for _ in range(60))
        finally:
            os.kill(pid, signal.SIGCONT)
            for connection in waiting:
                connection.close()
        self.assertEqual(call("domain/name", GetDomainNameService).domain_name, "home")

    def test_too_many_items_are_refused_with_their_number(self):
        for service, kind, args in (
            ("query_state", KnowledgeQueryService, ([fact("checked", "hall")] * 1001,)),
            ("update_array", KnowledgeUpdateServiceArray, ([0] * 1001, [fact("checked", "hall")] * 1001)),
        ):
            with self.assertRaisesRegex(rospy.ServiceException, "1001 items, more than the 1000"):
                call(service, kind, *args)
        answer = call("query_state", KnowledgeQueryService, [fact("checked", "hall")] * 1000)
        self.assertEqual(len(answer.false_knowledge), 1000)
        self.assertEqual(answer.false_knowledge[999], fact("checked", "hall"))

    def test_a_query_that_would_take_years_ends(self):
        variables = " ".join(f"?v{number}" for number in range(20))
        forever = expression(f"(forall ({variables} - poi) (or (checked ?v0) (not (checked ?v0))))")
        with self.assertRaisesRegex(rospy.ServiceException, "within the 1 s of ~max_query_time"):
            call("query_state", KnowledgeQueryService, [forever])

    def test_an_expression_of_ten_megabytes_is_refused_unread(self):
        long = expression(f"(and {'(checked hall)' * 700_000})")
        self.assertEqual(list(call("query_state", KnowledgeQueryService, [long]).results), [False])
        self.assertFalse(call("update", KnowledgeUpdateService, 1, long).success)
        self.assertIn("9800006 characters, more than 1000000", call("last_refusal", Trigger).message)

    def test_a_name_of_ten_megabytes_is_not_logged(self):
        lines = []
        subscriber = rospy.Subscriber("/rosout", Log, lambda line: lines.append(line))
        wait_for_publisher(subscriber, KB)
        name = "x" * 10_000_000
        self.assertFalse(call("update", KnowledgeUpdateService, 0, fact(name, "hall")).success)
        self.assertFalse(call("update", KnowledgeUpdateService, 0, fact("checked", name)).success)
        self.assertFalse(call("query_state", KnowledgeQueryService, [fact(name)]).all_true)
        with self.assertRaises(rospy.ServiceException):
            call("domain/operator_details", GetDomainOperatorDetailsService, name)
        instance = KnowledgeItem(knowledge_type=0, instance_type="poi", instance_name=name)
        self.assertTrue(call("update", KnowledgeUpdateService, 0, instance).success)
        self.assertTrue(call("update", KnowledgeUpdateService, 2, instance).success)
        with contextlib.suppress(ConnectionError), socket.create_connection(address("update")) as connection:
            write_ros_handshake_header(connection, {"service": name, "md5sum": "*", "callerid": "/fuzz"})
        self.assertFalse(call("update", KnowledgeUpdateService, 0, fact("last", "hall")).success)
        while not any("'last'" in line.msg for line in lines):
            rospy.rostime.wallsleep(0.01)
        subscriber.unregister()
        self.assertLess(max(len(line.msg) for line in lines), 2000)
