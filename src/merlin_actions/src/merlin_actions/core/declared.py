"""The numeric effects that an action declares for its interruption. Pure."""

import re
from typing import List, Mapping, Sequence, Tuple

_NUMERIC = re.compile(r"\s*\(\s*(assign|increase|decrease|scale-up|scale-down)\s", re.IGNORECASE)
_VARIABLE = re.compile(r"\?([A-Za-z_][\w-]*)")
#: The planned duration, a variable of PDDL's own.
DURATION = "duration"


def numeric_apart(texts: Sequence[str]) -> Tuple[List[str], List[str]]:
    """Literals, and numeric effects such as ``(decrease (battery) (* 0.1 #t))``."""
    numeric = [text for text in texts if _NUMERIC.match(text)]
    return [text for text in texts if text not in numeric], numeric


def bound(text: str, binding: Mapping[str, str]) -> str:
    """A numeric effect with objects for its variables; ``?duration`` stays.

    :raises ValueError: for a variable that is not bound.
    """

    def replace(match: "re.Match[str]") -> str:
        name = match.group(1)
        if name.lower() == DURATION:
            return match.group(0)
        if name not in binding:
            raise ValueError(f"{text!r}: nothing is bound to ?{name}")
        return binding[name]

    return _VARIABLE.sub(replace, text)
