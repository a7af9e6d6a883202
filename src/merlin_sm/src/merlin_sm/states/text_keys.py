# SPDX-License-Identifier: Apache-2.0
"""The userdata that a text with ``{key}`` names, and that a function reads. Pure."""

import dis
import inspect
import re
import string
from typing import Any, Callable, List, Optional, Sequence

from merlin_sm.userdata_keys import check_lists


def keys_of(texts: Sequence[str], keys: Optional[Sequence[str]] = None) -> List[str]:
    """The userdata keys of texts.

    :param keys: those that the author gives; None: what the texts name.
    :raises ValueError: when a text names one that is not given, or cannot be read.
    """
    check_lists(keys=keys)
    named: List[str] = []
    for text in texts:
        try:
            fields = [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]
        except ValueError as error:
            raise ValueError(f"the text {text!r} cannot be read: {error}; write {{{{ for a brace") from None
        for field in fields:
            key = re.split(r"[.\[]", field)[0]
            if not key:
                raise ValueError(f"the text {text!r} has braces without a name; write {{key}}")
            if keys is not None and key not in keys:
                given = ", ".join(keys) or "none"
                raise ValueError(f"the text {text!r} names {{{key}}}, which is not among its keys: {given}")
            named.append(key)
    return list(dict.fromkeys(named)) if keys is None else list(keys)


def filled(text: str, userdata: Any, form: Optional[string.Formatter] = None) -> str:
    """A text with the userdata that it names.

    :param form: writes the values; None: as ``str.format`` does.
    :raises ValueError: a key has no value, or its value is not as the text needs it.
    """
    try:
        return (form or string.Formatter()).vformat(text, (), userdata)
    except (LookupError, AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"the text {text!r} cannot be filled: {error}") from error


def keys_read(function: Callable[..., Any]) -> List[str]:
    """The userdata keys that a function, whose first argument is the userdata, itself reads by their names.

    What it hands on to another function is not followed; a callable without Python code reads none.
    """
    bound_to = getattr(function, "__self__", None)
    code = getattr(getattr(function, "__func__", function), "__code__", None)
    place = 0 if bound_to is None else 1
    if code is None or code.co_argcount <= place:
        return []
    name = code.co_varnames[place]
    found: List[str] = []
    steps = list(dis.get_instructions(code))
    for first, second, third in zip(steps, steps[1:], [*steps[2:], steps[-1]]):
        if first.opname.startswith("LOAD_FAST") and first.argval == name:
            item = second.opname == "LOAD_CONST" and third.opname == "BINARY_SUBSCR"
            if item or second.opname == "LOAD_ATTR":
                found.append(str(second.argval))
        elif first.opname in ("STORE_FAST", "DELETE_FAST") and first.argval == name:
            return []  # it is another object from here on
    return list(dict.fromkeys(found))


def check_call(function: Any, *arguments: str) -> None:
    """Whether a function that is given to a state can be called with these arguments.

    :raises ValueError: it takes fewer or more; the text names it.
    """
    try:
        inspect.signature(function).bind(*arguments)
    except TypeError as error:
        given = " and ".join(arguments)
        raise ValueError(f"{_place(function)} cannot be called with {given}: {error}; correct it") from error
    except ValueError:  # one of C has no signature
        return


def _place(function: Any) -> str:
    name = getattr(function, "__name__", type(function).__name__)
    return f"{name}, line {getattr(getattr(function, '__code__', None), 'co_firstlineno', 0)},"


def check_keys(
    function: Any, inputs: Sequence[str], outputs: Sequence[str], argument: str, *further: str
) -> None:
    """Compares the userdata that a function reads with what its state declares.

    :param argument: of the state that lists the inputs.
    :param further: with which the function is called behind the userdata.
    :raises ValueError: for the first key that it reads and the state does not list; or it takes fewer or more
        arguments.
    """
    check_lists(**{argument: inputs, "outputs": outputs})
    if not callable(function):
        if further and function is not None:
            raise ValueError(f"{function!r}, for the {further[0]}, is not a function")
        return
    check_call(function, "userdata", *further)
    for key in keys_read(function):
        # SMACH lets a state read what it sets itself; a method of userdata is not a key.
        if key not in (*inputs, *outputs, "keys", "get", "items", "update"):
            given = ", ".join(inputs) or "none"
            raise ValueError(
                f"{_place(function)} reads userdata {key!r}, which is not among the {argument} of its "
                f"state: {given}; add it"
            )
