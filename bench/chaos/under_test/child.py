# SPDX-License-Identifier: Apache-2.0
"""A process of the campaign's own, spoken to in lines of JSON: commands go in, events come out."""

import contextlib
import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import IO, Any, Callable, Dict, List, Optional

from chaos.judging.events import GONE, Event

#: s that a process may take to end after its input was closed.
END_LIMIT = 5.0


class Child:
    """Starts `python <module> …` and passes on its events.

    :param name: for messages and for the file that takes its error output.
    :param command: command line.
    :param on_event: called with each event, in a thread of the child's.
    :param folder: takes `<name>.err`.
    """

    def __init__(
        self,
        name: str,
        command: List[str],
        env: Dict[str, str],
        folder: Path,
        on_event: Callable[[Event], None],
    ) -> None:
        self.name = name
        self._on_event = on_event
        with (folder / f"{name}.err").open("ab") as errors:
            self.process = subprocess.Popen(
                command,
                env=env,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                bufsize=1,
                start_new_session=True,
            )
        self._sending = threading.Lock()  # one command at a time
        # Ends with the child's output.
        self._reader = threading.Thread(target=self._read, name=f"events of {name}", daemon=True)
        self._reader.start()

    def tell(self, **command: Any) -> bool:
        """Sends a command; False when the child has ended."""
        assert self.process.stdin is not None
        with self._sending:
            try:
                self.process.stdin.write(json.dumps(command) + "\n")
                self.process.stdin.flush()
            except (OSError, ValueError):
                return False
        return True

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def close(self) -> None:
        """Closes its input, which ends it, and kills it when that does not help."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(END_LIMIT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join(END_LIMIT)

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            try:
                message = json.loads(line)
            except ValueError:
                continue  # a library's own word
            self._on_event(Event(message.pop("at"), message.pop("kind"), message))
        self._on_event(Event(time.monotonic(), GONE, {"child": self.name}))


class Reporter:
    """The other end: used by a child to report events and to receive commands."""

    def __init__(self, out: Optional[IO[str]] = None) -> None:
        self._lock = threading.Lock()  # whole lines only
        self._out = out or sys.stdout

    def __call__(self, kind: str, **data: Any) -> None:
        """Reports an event of now."""
        line = json.dumps({"at": time.monotonic(), "kind": kind, **data})
        with self._lock, contextlib.suppress(OSError, ValueError):
            self._out.write(line + "\n")
            self._out.flush()


def commands(source: IO[str]) -> Any:
    """The commands that come in, until the input is closed."""
    for line in source:
        if line.strip():
            yield json.loads(line)
