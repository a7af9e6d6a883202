"""How long the spoken question is, measured on the sound itself."""

import subprocess
import tempfile
import wave
from pathlib import Path

SYNTHESIS_TIMEOUT = 10.0
"""Wall seconds that the synthesis of one sentence may take."""


class SpeechLengthError(RuntimeError):
    """The length cannot be measured; the text says why and what to do."""


def speech_length(text: str) -> float:
    """Length of a sentence as espeak-ng speaks it, s.

    Raises:
        SpeechLengthError: espeak-ng is missing or failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "question.wav"
        command = ["espeak-ng", "-w", str(file), text]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=SYNTHESIS_TIMEOUT)
            with wave.open(str(file)) as sound:
                return sound.getnframes() / sound.getframerate()
        except (OSError, subprocess.SubprocessError, wave.Error) as error:
            raise SpeechLengthError(
                f"cannot measure the question with espeak-ng ({error}); install it, or set ~speech_length"
            ) from error
