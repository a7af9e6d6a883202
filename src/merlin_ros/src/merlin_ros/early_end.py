# SPDX-License-Identifier: Apache-2.0
"""Import this first in an executable: SIGINT and SIGTERM then end it quietly while it still imports the rest.

Python would show where in the imports it was interrupted. Nothing has begun then that needs an orderly end;
:func:`merlin_ros.node.init_node` puts its own handlers in place of this one.
"""

import os
import signal
import threading
from typing import Any


def _end(number: int, _frame: Any) -> None:
    os._exit(0 if number == signal.SIGINT else 128 + number)  # as `merlin_ros.node.run_node` does


if threading.current_thread() is threading.main_thread():
    for _signal in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(_signal) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(_signal, _end)
