# SPDX-License-Identifier: Apache-2.0
"""Signals that end a process: their names; a command tidies up first, however it is ended."""

import contextlib
import signal
from typing import Any, Dict, Iterator


@contextlib.contextmanager
def handled(handlers: Dict[signal.Signals, Any]) -> Iterator[None]:
    """Handles signals, until the context ends."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def signal_name(number: int) -> str:
    """``SIGKILL``; ``signal 37`` of a real-time signal, which has no name."""
    with contextlib.suppress(ValueError):
        return signal.Signals(number).name
    return f"signal {number}"


def _end(number: int, frame: Any) -> None:
    raise SystemExit(128 + number)


#: Also SIGTERM and SIGHUP tidy up, as Ctrl-C does.
TIDY = {signal.SIGTERM: _end, signal.SIGHUP: _end, signal.SIGINT: signal.default_int_handler}
