# SPDX-License-Identifier: Apache-2.0
"""Names that SMACH programs import from here."""

from smach.cb_interface import CBInterface, cb_interface, has_smach_interface
from smach.log import is_shutdown, set_loggers, set_shutdown_check

__all__ = [
    "CBInterface",
    "cb_interface",
    "has_smach_interface",
    "is_shutdown",
    "set_loggers",
    "set_shutdown_check",
]
