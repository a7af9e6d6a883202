# SPDX-License-Identifier: Apache-2.0
"""How large a request may be, and how many may wait: one client must not keep the Executor from the others.

Pure.
"""

from typing import Mapping, Sequence

MAX_GOALS = 1000  #: Goals of a request, texts and items.
MAX_TEXT = 65536  #: Characters of all goal texts of a request together.
MAX_TOKENS = 1000  #: Tokens of an expression in a knowledge item.
MAX_OF_CLIENT = 200  #: Requests of one client that wait.
MAX_WAITING = 1000  #: Requests of all clients that wait.
MAX_PRIORITY = 2**31 - 1  #: That of an int32.
ON_INTERRUPT = {"RESUME": 0, "DROP": 1, "NEVER": 2}  #: Those of merlin_msgs/Execute.
ON_CLIENT_LOST = {"GO_ON": 0, "CANCEL": 1}  #: Likewise.
LEAST_VALUE, LARGEST_VALUE = 2.0**-100, 2.0**100  #: Exact in a float32, with room beyond.


class RequestTooLarge(ValueError):
    """A request beyond a limit; the text says which."""


def check_size(texts: Sequence[str], items: int = 0, tokens: int = 0) -> None:
    """Checks a request before anything is parsed; the depth of texts is checked by the parser.

    :param texts: goals as PDDL text.
    :param items: number of further goals that are knowledge items.
    :param tokens: of the largest expression in them.
    :raises RequestTooLarge: beyond a limit.
    """
    goals = len(texts) + items
    if goals > MAX_GOALS:
        raise RequestTooLarge(f"the request has {goals} goals; it may have {MAX_GOALS}")
    length = sum(map(len, texts))
    if length > MAX_TEXT:
        raise RequestTooLarge(f"the goals of the request have {length} characters; they may have {MAX_TEXT}")
    if tokens > MAX_TOKENS:
        raise RequestTooLarge(f"an expression of the request has {tokens} tokens; it may have {MAX_TOKENS}")


def check_value(value: float) -> float:
    """Returns the value of a request.

    :raises RequestTooLarge: when it is not a number above 0, or one that the message cannot hold.
    """
    if not (isinstance(value, (int, float)) and LEAST_VALUE <= value <= LARGEST_VALUE):
        raise RequestTooLarge(
            f"the value of the request is {value!r}; it has to be a number above 0, from 1e-30 to 1e30"
        )
    return value


def check_priority(priority: int) -> int:
    """Returns the priority of a request.

    :raises RequestTooLarge: when it is not a whole number that the message can hold.
    """
    if not isinstance(priority, int) or abs(priority) > MAX_PRIORITY:
        raise RequestTooLarge(
            f"the priority of the request is {priority!r}; it has to be a whole number from "
            f"-{MAX_PRIORITY} to {MAX_PRIORITY}"
        )
    return priority


def check_choice(field: str, number: int, choices: Mapping[str, int]) -> int:
    """Returns the number of a choice in a request.

    :param field: of the message, for the error.
    :param choices: name → number.
    :raises RequestTooLarge: for another number.
    """
    if number not in choices.values():
        known = ", ".join(f"{name} ({known})" for name, known in choices.items())
        raise RequestTooLarge(f"{field} of the request is {number!r}; it has to be one of {known}")
    return number


def why_full(waiting: Sequence[str], client: str) -> str:
    """Why no further request of a client may wait, as a sentence; empty: it may.

    :param waiting: the client of each request that waits.
    :param client: its node; those of clients that are not known are counted together.
    """
    if len(waiting) >= MAX_WAITING:
        return f"{len(waiting)} requests wait already; no more may"
    own = sum(other == client for other in waiting)
    if own >= MAX_OF_CLIENT:
        return f"{own} requests of {client or 'clients without a name'} wait already; no more may"
    return ""
