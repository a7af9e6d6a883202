# SPDX-License-Identifier: Apache-2.0
"""A file that notes goals, for the next process of this node. Without ROS."""

import json
import os
from pathlib import Path
from typing import List, Sequence


class NotesError(ValueError):
    """The file holds something else than a list of goals; the text shows its beginning."""


class GoalNotes:
    """Goals as PDDL text in a file, which is replaced as a whole: a crash leaves the old list or the new one.

    :param path: of the file; made with its folder when it does not exist.
    :raises OSError: when it cannot be written.
    """

    def __init__(self, path: str) -> None:
        self.path = Path(path).expanduser()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.touch()

    def write(self, texts: Sequence[str]) -> None:
        """Notes these goals and no others. They are on the disk when this returns: the knowledge base, to
        which they go next, keeps them over a power cut. That no goal is left need not be there.

        :raises OSError: when the file cannot be written.
        """
        new = self.path.with_name(self.path.name + ".new")
        with new.open("w") as file:
            file.write(json.dumps(list(texts)))
            file.flush()
            if texts:
                os.fsync(file.fileno())
        os.replace(new, self.path)
        if texts:
            self._sync_name()

    def _sync_name(self) -> None:
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def read(self) -> List[str]:
        """The goals noted last; empty when no goal is noted.

        :raises OSError: when the file cannot be read.
        :raises NotesError: when it holds something else.
        """
        text = self.path.read_text(errors="replace")
        try:
            noted = json.loads(text) if text else []
        except ValueError:
            noted = None
        if not isinstance(noted, list):
            raise NotesError(f"{self.path} is not a list of goals: {text[:80]!r}")
        return list(map(str, noted))
