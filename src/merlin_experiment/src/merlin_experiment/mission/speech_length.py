# SPDX-License-Identifier: Apache-2.0
"""How long the question of the paper's tasks is."""

from merlin_home.question import QUESTION
from merlin_reactive.speech.speech_synthesizer import SoundError, SpeechSynthesizer


class SpeechLengthError(RuntimeError):
    """The length cannot be measured; the text says why and what to do."""


def speech_length() -> float:
    """Length of the question, s, measured on the sound that the simulated robot plays.

    :raises SpeechLengthError: it cannot be synthesised.
    """
    try:
        return SpeechSynthesizer().say(QUESTION).duration
    except SoundError as error:
        raise SpeechLengthError(f"{error}; or set ~speech_length") from error
