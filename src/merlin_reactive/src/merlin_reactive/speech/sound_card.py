# SPDX-License-Identifier: Apache-2.0
"""The machine's sound card, where there is one."""

import contextlib
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Optional

import rospy

from merlin_reactive.speech.speech_synthesizer import RATE, Sound

CARDS = Path("/proc/asound/cards")


class SoundCard:
    """Plays with aplay; does nothing on a machine without a card.

    :param device: ALSA name; empty: the default one.
    """

    def __init__(self, device: str = "") -> None:
        self._device = device
        self._process: Optional[subprocess.Popen[bytes]] = None
        self.present = shutil.which("aplay") is not None and _has_card()

    def play(self, sound: Sound) -> None:
        """Begins to play a sound."""
        if not self.present:
            return
        command = ["aplay", "-q", "-t", "raw", "-f", "S16_LE", "-c", "1", "-r", str(RATE)]
        if self._device:
            command += ["-D", self._device]
        try:
            # A file instead of a pipe: no thread has to feed it while it plays.
            with tempfile.TemporaryFile() as file:
                file.write(sound.samples.astype("<i2").tobytes())
                file.seek(0)
                self._process = subprocess.Popen(
                    command, stdin=file, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
                )
        except OSError as error:
            self.present = False
            rospy.logwarn(f"speech: the sound card is left alone from now on: {error}")

    def stop(self) -> None:
        """Ends what is playing."""
        process, self._process = self._process, None
        if process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        process.wait()


def _has_card() -> bool:
    try:
        text = CARDS.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return bool(text.strip()) and "no soundcards" not in text
