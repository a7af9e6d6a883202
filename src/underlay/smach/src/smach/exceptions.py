# SPDX-License-Identifier: Apache-2.0
"""What SMACH raises. Each error is logged when it is made, so it is seen even where it is caught."""

import smach


class SmachError(Exception):
    """Base of all errors of this package.

    :param message: what is wrong, where, and what to do.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(message)
        smach.logerr(f"{type(self).__name__}: {message}")


class InvalidStateError(SmachError):
    """A container or a state that cannot be used as it is."""


class InvalidTransitionError(SmachError):
    """An outcome or a transition that was not declared."""


class InvalidConstructionError(SmachError):
    """Arguments that cannot make a state or a container."""


class InvalidUserCodeError(SmachError):
    """User code that raised or broke its declared interface; carries the traceback and the cause."""
