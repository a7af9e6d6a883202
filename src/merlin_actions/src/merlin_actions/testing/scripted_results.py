# SPDX-License-Identifier: Apache-2.0
"""Results that a test writes down: what a simulated server answers, goal by goal."""

from typing import Any, Mapping

from genpy.message import MessageException, fill_message_args

from merlin_actions.testing.result_script import fields_of


class ScriptedResults:
    """The results of an action's goals, one after the other; the last one stays.

    :param result_class: the generated ``...Result`` class.
    :param script: see :func:`.result_script.fields_of`.
    :raises ValueError: when the script does not fit the result.
    """

    def __init__(self, result_class: type, script: Mapping[str, Any]) -> None:
        self._class = result_class
        self._fields = fields_of(script)
        for number in range(len(self._fields)):
            self.result(number)

    def result(self, number: int) -> Any:
        """The result of the goal of that number, counted from 0."""
        message = self._class()
        fields = self._fields[min(number, len(self._fields) - 1)]
        try:
            fill_message_args(message, [fields])
        except (MessageException, TypeError, ValueError) as error:
            raise ValueError(f"{self._class.__name__} cannot be {fields}: {error}") from None
        return message
