# SPDX-License-Identifier: Apache-2.0
"""Breakpoints of actions, requests or states that begin one after the other: hold, step and continue.

Pure. The dispatcher has one for its actions, the Executor one for its requests.
"""

import re
import threading
from typing import List, Sequence, Tuple

ANY = "*"
MOST = 100
LONGEST = 400  # characters of one
_WORD = re.compile(r"[^\s()?;*]+\Z")
_FORMULA = re.compile(r"\(([^()]*)\)")
Pattern = Tuple[str, ...]


class BreakpointError(ValueError):
    """A text that is not a breakpoint; the message says why."""


def read_pattern(text: str) -> Pattern:
    """The words of a breakpoint: ``(navigate * kitchen)``; a name alone is for any arguments.

    :raises BreakpointError: it is something else.
    """
    shown = text if len(text) <= 60 else f"{text[:57]}..."
    inner = text.strip()
    if inner.startswith("(") and inner.endswith(")"):
        inner = inner[1:-1]
    words = tuple(inner.lower().split())
    valid = words and _WORD.match(words[0]) and all(word == ANY or _WORD.match(word) for word in words)
    if not valid or len(text) > LONGEST:
        raise BreakpointError(
            f"'{shown}' is not a breakpoint; write an action or a fact like (navigate * kitchen)"
        )
    return words


class Breakpoints:
    """What is held before it begins. Thread-safe.

    A step lets what is held begin, and holds the next one whatever it is.
    """

    def __init__(self) -> None:
        self.armed = False
        """Whether anything may be held; without it nothing else needs to be asked."""
        self._lock = threading.Lock()  # guards the fields below, and changes of `armed`
        self._texts: Tuple[str, ...] = ()
        self._patterns: Tuple[Pattern, ...] = ()
        self._stepping = False
        self.held = ""
        """What is held now, as PDDL text; empty: nothing."""
        self._released = ""  # was held, and has not begun yet

    @property
    def texts(self) -> List[str]:
        """The breakpoints as they were given."""
        return list(self._texts)

    def set(self, texts: Sequence[str]) -> None:
        """Replaces the breakpoints; what is held stays so.

        :raises BreakpointError: when one is not a breakpoint, or they are too many; the old ones stay.
        """
        if len(texts) > MOST:
            raise BreakpointError(f"there can be {MOST} breakpoints at most")
        found = {read_pattern(text): text.strip() for text in texts}
        with self._lock:
            self._patterns, self._texts = tuple(found), tuple(found.values())
            self._arm()

    def step(self) -> None:
        """Continues what is held; holds the next one."""
        self._release(True)

    def go_on(self) -> None:
        """Continues what is held, up to the next breakpoint."""
        self._release(False)

    def admit(self, asked: Sequence[str]) -> List[int]:
        """Which of those that could begin now may; the first that may not is held.

        :param asked: as PDDL text.
        :return: indices, in the order in which they are to begin.
        """
        with self._lock:
            if self.held and self.held in asked:
                return []
            self.held = ""
            admitted = [index for index, text in enumerate(asked) if text and text == self._released][:1]
            if admitted and self._stepping:
                return admitted
            for index, text in enumerate(asked):
                if index in admitted:
                    continue
                if self._stepping or self._matches(text):
                    self.held = text
                    break
                admitted.append(index)
            self._arm()
            return admitted

    def began(self, text: str) -> None:
        """Notes that a held item has begun: the same one is held the next time."""
        with self._lock:
            if text == self._released:
                self._released = ""
                self._arm()

    def ended(self, stepping: bool) -> None:
        """Withdraws an item that waits to begin.

        :param stepping: whether a step continues with what comes next.
        """
        with self._lock:
            self.held = self._released = ""
            self._stepping = self._stepping and stepping
            self._arm()

    def _release(self, stepping: bool) -> None:
        with self._lock:
            if self.held:
                self._released, self.held = self.held, ""
            self._stepping = stepping
            self._arm()

    def _matches(self, text: str) -> bool:
        formulas = [found.lower().split() for found in _FORMULA.findall(text)]
        return any(fits(pattern, words) for pattern in self._patterns for words in formulas)

    def _arm(self) -> None:
        self.armed = bool(self._patterns or self._stepping or self.held or self._released)


def fits(pattern: Pattern, words: Sequence[str]) -> bool:
    """Whether a pattern is for these words; one of a single word is for any behind it."""
    if len(pattern) == 1:
        return list(pattern) == words[:1]
    return len(pattern) == len(words) and all(wanted in (ANY, word) for wanted, word in zip(pattern, words))
