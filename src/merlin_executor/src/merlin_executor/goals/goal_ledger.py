# SPDX-License-Identifier: Apache-2.0
"""Which goals of a knowledge base are this Executor's, and which lease names them. Pure.

A lease is ``<unique word> (and <goal> …)``: so a knowledge base knows what it is about without asking.
"""

import itertools
import json
import os
from pathlib import Path
from typing import Callable, Collection, Generic, List, Sequence, TypeVar

Item = TypeVar("Item")


class GoalLedger(Generic[Item]):
    """The goals that were added and are not removed, each once.

    :param text: a goal as PDDL text.
    :param life: names this process; begins its leases.
    """

    def __init__(self, text: Callable[[Item], str], life: str) -> None:
        self._text = text
        self._life = life
        self._numbers = itertools.count(1)
        self._added: List[Item] = []  # by the last addition
        self._open = False  # whether an addition is still unanswered
        self.items: List[Item] = []
        """The goals, the oldest first."""
        self.lease = ""
        """Names the goals that are left; empty: all were removed."""

    @property
    def texts(self) -> List[str]:
        """The goals as PDDL text."""
        return [self._text(item) for item in self.items]

    def with_these(self, items: Sequence[Item]) -> List[str]:
        """What :attr:`texts` will be when these are added."""
        return [*self.texts, *map(self._text, self._new(items))]

    def begin(self, items: Sequence[Item]) -> None:
        """Goals are about to be added: they count from now on, an addition too many is harmless.

        The lease is a new one: the old one may be lost for good.
        """
        self._added = self._new(items)
        self.items += self._added
        self._open = True
        self._name()

    def answered(self) -> None:
        """The addition was carried out."""
        self._open = False

    def refused(self) -> None:
        """The addition was refused as a whole: its goals are not stored, and may not be removable either."""
        self._open = False
        kept = len(self.items) - len(self._added)
        self.items, self._added = self.items[:kept], []
        self._name()

    def inherit(self, items: Sequence[Item]) -> None:
        """Goals that an earlier process of this node has added, under its own lease."""
        self.items += self._new(items)

    def removed(self) -> bool:
        """The goals were removed.

        :return: whether for good. An addition that had no answer may come true later: after the first removal
            behind it they are kept, to be removed once more.
        """
        if self._open:
            self._open = False
            return False
        self.items = []
        self.lease = ""
        return True

    def others(self, texts: Collection[str]) -> List[Item]:
        """The goals that are not among others; none while an addition is unanswered, which may add them."""
        wanted = {text.lower() for text in texts}
        return [] if self._open else [item for item in self.items if self._text(item).lower() not in wanted]

    def dropped(self, items: Sequence[Item]) -> None:
        """Some of the goals were removed; the others get a lease of their own."""
        self.items = [item for item in self.items if item not in items]
        self._name()

    def _name(self) -> None:
        goals = " ".join(self.texts)
        self.lease = f"{self._life}-{next(self._numbers)} (and {goals})" if goals else ""

    def _new(self, items: Sequence[Item]) -> List[Item]:
        known = set(self.texts)
        return [item for item in items if self._text(item) not in known]


class GoalNotes:
    """Goals as PDDL text in a file, which is replaced as a whole: a crash leaves the old list or the new one.

    :param path: of the file; made with its folder when it does not exist.
    :param sync_end: whether it has to be on the disk, too, that no goal is left.
    :raises OSError: when it cannot be written.
    """

    def __init__(self, path: str, sync_end: bool = False) -> None:
        self._sync_end = sync_end
        self.path = Path(path).expanduser()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.open("a").close()  # touch() would take a folder
        self._new = self.path.with_name(self.path.name + ".new")
        self._new.open("w").close()  # fails now, not with the first goal, where the folder is read only
        self._new.unlink()

    def write(self, texts: Sequence[str]) -> None:
        """Notes these goals and no others. They are on the disk when this returns: the knowledge base, to
        which they go next, keeps them over a power cut. That no goal is left need not be there by default.

        :raises OSError: when the file cannot be written; the text names it.
        """
        try:
            self._replace(json.dumps(list(texts)), bool(texts) or self._sync_end)
        except OSError as error:  # that of a full disk has no name
            raise OSError(f"{self.path} cannot be written: {error.strerror}") from error

    def _replace(self, text: str, sync: bool) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)  # it may have been removed since
        with self._new.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            if sync:
                os.fsync(file.fileno())
        os.replace(self._new, self.path)
        if sync:
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
        :raises ValueError: when it holds something else; the text shows its beginning.
        """
        text = self.path.read_text(encoding="utf-8", errors="replace")
        try:
            noted = json.loads(text) if text else []
        except ValueError:
            noted = None
        if not isinstance(noted, list):
            raise ValueError(f"{self.path} is not a list of goals: {text[:80]!r}")
        return list(map(str, noted))
