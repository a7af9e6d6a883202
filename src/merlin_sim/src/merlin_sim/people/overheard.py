# SPDX-License-Identifier: Apache-2.0
"""Which person heard which sentence of the robot. Without ROS.

The text, the sound, the begin and the end of a sentence come over connections of their own: on a busy machine
in any order.
"""

from typing import Generic, Optional, TypeVar

Hearer = TypeVar("Hearer")


class Sentence(Generic[Hearer]):
    """A sentence that the robot speaks.

    :ivar text: None: not known yet.
    :ivar hearer: None: not heard yet.
    """

    def __init__(self, text: Optional[str], hearer: Optional[Hearer]) -> None:
        self.text = text
        self.hearer = hearer
        self.over = False
        self.asked = False

    def ask(self) -> "Optional[Sentence[Hearer]]":
        """This sentence when it is over, was heard, and is to be answered now; once."""
        if not self.over or self.hearer is None or self.asked:
            return None
        self.asked = True
        return self


class Overheard(Generic[Hearer]):
    """Puts together what belongs to one sentence. Not thread-safe."""

    def __init__(self) -> None:
        self.last_text = ""
        self._requested: Optional[str] = None  # and not begun
        self._hearer: Optional[Hearer] = None  # of sound that came before the begin
        self._sentence: Optional[Sentence[Hearer]] = None

    def request(self, text: str) -> None:
        """A text is to be spoken."""
        self.last_text = text
        if self._sentence is not None and self._sentence.text is None:
            self._sentence.text = text
        else:
            self._requested = text

    def begin(self) -> None:
        """The robot begins to speak."""
        self._sentence = Sentence(self._requested, self._hearer)
        self._requested = self._hearer = None

    def sound(self, hearer: Hearer) -> Optional[Sentence[Hearer]]:
        """A part of it was heard; returns a sentence that is to be answered now."""
        if self._sentence is None or self._sentence.asked:
            self._hearer = hearer
            return None
        self._sentence.hearer = hearer
        return self._sentence.ask()

    def end(self) -> Optional[Sentence[Hearer]]:
        """The robot is silent; returns a sentence that is to be answered now."""
        if self._sentence is None:
            if self._hearer is None:
                return None
            self.begin()  # it was missed
        assert self._sentence is not None
        self._sentence.over = True
        return self._sentence.ask()
