"""Whether a goal makes sense: its names, numbers of arguments and objects. Pure."""

from typing import Collection, Mapping, Sequence


class GoalError(ValueError):
    """A goal that cannot be meant; the text says why."""


def check_atom(
    text: str,
    kind: str,
    name: str,
    arguments: Sequence[str],
    known: Mapping[str, int],
    objects: Collection[str],
) -> None:
    """Checks one predicate or function of a goal. Names do not depend on case.

    :param text: the goal, for messages.
    :param kind: ``predicate`` or ``function``, likewise.
    :param arguments: names of objects.
    :param known: names of that kind in the domain, and how many arguments each takes.
    :param objects: of the world, in lower case.
    :raises GoalError: when it is unknown, takes another number of arguments, or an object is unknown.
    """
    expected = {key.lower(): count for key, count in known.items()}.get(name.lower())
    if expected is None:
        names = ", ".join(sorted(known)) or "none"
        raise GoalError(f"{text}: the domain has no {kind} {name!r}, only {names}")
    if len(arguments) != expected:
        raise GoalError(f"{text}: {name!r} takes {expected} arguments, not {len(arguments)}")
    for argument in arguments:
        if argument.lower() not in objects:
            raise GoalError(f"{text}: there is no object {argument!r}")
