#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""A client that wants the kitchen checked until it is killed; with ``--go-on`` beyond that."""

import sys

import rospy

from merlin_executor.executor_client import CANCEL, GO_ON, MerlinExecutorClient

rospy.init_node("executor_victim")
client = MerlinExecutorClient(on_client_lost=GO_ON if "--go-on" in sys.argv else CANCEL)
client.wait_for_executor()
client.send("(checked kitchen)")
rospy.spin()
