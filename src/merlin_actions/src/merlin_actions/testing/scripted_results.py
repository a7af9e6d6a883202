"""Results that a test writes down: what a simulated server answers, goal by goal."""

from typing import Any, Dict, List, Mapping, Sequence

from genpy.message import MessageException, fill_message_args


class ScriptedResults:
    """The results of an action's goals, one after the other; the last one stays.

    :param result_class: the generated ``...Result`` class.
    :param script: ``results``: for each goal its fields and their values; or ``answers``: texts of ``listen``
        (the empty one is misunderstood); or ``sees``: for each goal of ``recognize`` a list of names, or one
        list for all.
    :raises ValueError: when the script does not fit the result.
    """

    def __init__(self, result_class: type, script: Mapping[str, Any]) -> None:
        self._class = result_class
        given = [key for key in ("results", "answers", "sees") if script.get(key) is not None]
        if len(given) > 1:
            raise ValueError(f"give one of results, answers and sees, not {' and '.join(given)}")
        self._fields: List[Dict[str, Any]] = [{}]
        if given:
            values = script[given[0]]
            if not isinstance(values, list) or not values:
                raise ValueError(f"{given[0]} has to be a list with one value or more, not {values!r}")
            self._fields = getattr(self, f"_of_{given[0]}")(values)
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

    @staticmethod
    def _of_results(values: Sequence[Any]) -> List[Dict[str, Any]]:
        if not all(isinstance(value, dict) for value in values):
            raise ValueError("results has to be a list of fields and their values: [{text: 'yes'}]")
        return list(values)

    @staticmethod
    def _of_answers(values: Sequence[Any]) -> List[Dict[str, Any]]:
        if not all(isinstance(value, str) for value in values):
            raise ValueError(
                f"answers has to be a list of texts, not {values!r}; quote 'yes' and 'no' in YAML"
            )
        return [{"text": value, "confidence": float(bool(value)), "heard": True} for value in values]

    @staticmethod
    def _of_sees(values: Sequence[Any]) -> List[Dict[str, Any]]:
        looks = values if all(isinstance(value, list) for value in values) else [values]
        return [_detections([str(name) for name in names]) for names in looks]


def _detections(names: Sequence[str]) -> Dict[str, Any]:
    known = list(dict.fromkeys(names))
    detections = [{"results": [{"id": known.index(name), "score": 1.0}]} for name in names]
    return {"names": known, "detections": {"detections": detections}}
