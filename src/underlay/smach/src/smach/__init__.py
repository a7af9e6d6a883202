# SPDX-License-Identifier: Apache-2.0
"""Hierarchical state machines in pure Python, API of SMACH.

The package needs neither ROS nor any other library. The README describes the names.
"""

from smach import util
from smach.cb_interface import CBInterface, cb_interface, has_smach_interface
from smach.concurrence import Concurrence
from smach.container import Container
from smach.exceptions import (
    InvalidConstructionError,
    InvalidStateError,
    InvalidTransitionError,
    InvalidUserCodeError,
    SmachError,
)
from smach.iterator import Iterator
from smach.log import is_shutdown, logdebug, logerr, loginfo, logwarn, set_loggers, set_shutdown_check
from smach.sequence import Sequence
from smach.state import CBState, State
from smach.state_machine import StateMachine
from smach.user_data import Remapper, UserData, set_strict_userdata

__all__ = [
    "CBInterface",
    "CBState",
    "Concurrence",
    "Container",
    "InvalidConstructionError",
    "InvalidStateError",
    "InvalidTransitionError",
    "InvalidUserCodeError",
    "Iterator",
    "Remapper",
    "Sequence",
    "SmachError",
    "State",
    "StateMachine",
    "UserData",
    "cb_interface",
    "has_smach_interface",
    "is_shutdown",
    "logdebug",
    "logerr",
    "loginfo",
    "logwarn",
    "set_loggers",
    "set_shutdown_check",
    "set_strict_userdata",
    "util",
]
