"""How large a request may be: what one client sends must not keep the Executor from the others. Pure."""

from typing import Sequence

MAX_GOALS = 1000  #: Goals of a request, texts and items.
MAX_TEXT = 65536  #: Characters of all goal texts of a request together.
MAX_TOKENS = 1000  #: Tokens of an expression in a knowledge item.


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
