#!/usr/bin/env -S python3 -m merlin_test
# SPDX-License-Identifier: Apache-2.0
"""The cases of dispatch.test, over one start of its nodes."""

import unittest

from dispatch_owner_test import Limits, Owner, Patient
from dispatcher_ends_test import DispatcherEnds
from plan_dispatch_test import (
    DispatchingOfItsOwnProcess,
    EsterelDispatching,
    EsterelLimits,
    PatientEsterel,
    PatientSimple,
    SimpleDispatching,
    SimpleLimits,
)

import rostest
from merlin_test.topic_links import init_node

CASES = (
    DispatcherEnds,  # first: its dispatchers need not hear what the others do
    DispatchingOfItsOwnProcess,
    EsterelDispatching,
    SimpleDispatching,
    Owner,
    EsterelLimits,
    SimpleLimits,
    Limits,
    Patient,
    PatientEsterel,
    PatientSimple,
)


def suite():
    return unittest.TestSuite(map(unittest.defaultTestLoader.loadTestsFromTestCase, CASES))


if __name__ == "__main__":
    init_node("dispatch_test")
    rostest.rosrun("merlin_test", "dispatch", "__main__.suite")
