# SPDX-License-Identifier: Apache-2.0
"""Actions of the home that say where a more urgent request may interrupt them."""

from merlin_actions.actions import navigate
from merlin_home.actions import ask


class Navigate(navigate.Navigate):
    """A drive: anywhere on the way."""

    safe_to_interrupt = ("DRIVE",)


class Ask(ask.Ask):
    """A question: nowhere."""

    safe_to_interrupt = ()
