# SPDX-License-Identifier: Apache-2.0
"""Classes by their names, as launch files and command lines give them: ``package.module:Class``."""

import importlib
import traceback
from pathlib import Path
from typing import Any, Callable

from merlin_ros.lean_start import importing
from merlin_ros.work.threads import failure_text

#: What is wrong with an instance that lacks what its base class makes.
WITHOUT_BASE = "its __init__ does not call super().__init__()"


def load_class(path: str) -> type:
    """The class behind ``package.module:Class``.

    :raises ValueError: when it does not exist, with the reason.
    """
    found = _load(path)
    if not isinstance(found, type):
        raise ValueError(f"{path!r} is not a class")
    return found


def load_function(path: str) -> Callable[..., Any]:
    """The function behind ``package.module:function``.

    :raises ValueError: when it does not exist, with the reason.
    """
    found = _load(path)
    if not callable(found):
        raise ValueError(f"{path!r} is not a function")
    return found


def cannot_be_made(path: str, error: BaseException) -> str:
    """Why a class of an application cannot be instantiated, with its line that raised the error.

    :param path: ``package.module:Class``.
    :param error: which its constructor or its ``build`` has raised.
    """
    frames = traceback.extract_tb(error.__traceback__)
    module = f"{path.partition(':')[0].replace('.', '/')}.py"
    own = [frame for frame in frames if frame.name == "build" or frame.filename.endswith(module)]
    place = f" ({Path(own[-1].filename).name}, line {own[-1].lineno})" if own else ""
    said = str(error) if isinstance(error, ValueError) else failure_text(error)
    return f"{path} cannot be made: {said}{place}"


def _load(path: str) -> Any:
    module_name, colon, name = path.partition(":")
    if not colon:
        raise ValueError(f"{path!r} is not a class path; write package.module:Class")
    try:
        with importing():
            module = importlib.import_module(module_name)
    except (ImportError, SyntaxError) as error:
        raise ValueError(f"{path!r}: {error}") from error
    except (Exception, SystemExit) as error:  # of users' code, at its import
        frame = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}, line {frame.lineno}"
        raise ValueError(f"{path!r}: {failure_text(error)} ({place})") from error
    found = getattr(module, name, None)
    if found is None:
        raise ValueError(f"{path!r}: module {module_name} has no {name}")
    return found
