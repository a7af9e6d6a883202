# SPDX-License-Identifier: Apache-2.0
"""How long the question of the paper's tasks is."""

from merlin_home.question import QUESTION
from merlin_reactive.speech.speech_synthesizer import SoundError, SpeechSynthesizer


def speech_length() -> float:
    """Length of the question, s, measured on the sound that the simulated robot plays.

    :raises SoundError: it cannot be synthesised.
    """
    try:
        return SpeechSynthesizer().say(QUESTION).duration
    except SoundError as error:
        raise SoundError(f"{error}; or set ~speech_length") from error
