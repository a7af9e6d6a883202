# SPDX-License-Identifier: Apache-2.0
"""What a test writes down for a simulated server, as the fields of its results, goal by goal."""

from typing import Any, Callable, Dict, List, Mapping, Sequence

from genpy.message import MessageException, fill_message_args

from merlin_ros.robot_values import texts

Fields = Dict[str, Any]


def fields_of(script: Mapping[str, Any]) -> List[Fields]:
    """The fields of the results, goal by goal; of one empty result when nothing is written down.

    :param script: ``results``: for each goal its fields and their values; or ``answers``: texts of ``listen``
        (the empty one is misunderstood); or ``sees``: for each goal of ``recognize`` a list of names, or one
        list for all.
    :raises ValueError: when it is something else.
    """
    given = [key for key in _READERS if script.get(key) is not None]
    if len(given) > 1:
        raise ValueError(f"give one of results, answers and sees, not {' and '.join(given)}")
    if not given:
        return [{}]
    values = script[given[0]]
    if not isinstance(values, list) or not values:
        raise ValueError(f"{given[0]} has to be a list with one value or more, not {values!r}")
    return _READERS[given[0]](values)


def _results(values: Sequence[Any]) -> List[Fields]:
    if not all(isinstance(value, dict) for value in values):
        raise ValueError("results has to be a list of fields and their values: [{text: 'yes'}]")
    return list(values)


def _answers(values: Sequence[Any]) -> List[Fields]:
    answers = texts("answers", values)
    return [{"text": value, "confidence": float(bool(value)), "heard": True} for value in answers]


def _sees(values: Sequence[Any]) -> List[Fields]:
    looks = values if all(isinstance(value, list) for value in values) else [values]
    return [_detections([str(name) for name in names]) for names in looks]


def _detections(names: Sequence[str]) -> Fields:
    known = list(dict.fromkeys(names))
    detections = [{"results": [{"id": known.index(name), "score": 1.0}]} for name in names]
    return {"names": known, "detections": {"detections": detections}}


_READERS: Dict[str, Callable[[Sequence[Any]], List[Fields]]] = {
    "results": _results,
    "answers": _answers,
    "sees": _sees,
}


class ScriptedResults:
    """The results of an action's goals, one after the other; the last one stays.

    :param result_class: the generated ``...Result`` class.
    :param script: see :func:`fields_of`.
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
