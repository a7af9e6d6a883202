# SPDX-License-Identifier: Apache-2.0
"""Turns text and files into sound: 16-bit mono samples of one rate."""

import io
import os
import subprocess
import threading
import wave
from collections import OrderedDict
from dataclasses import dataclass
from typing import BinaryIO, List, Optional, Tuple

import numpy as np

RATE = 16000  # samples per second of everything that is played; what recognisers want
LOWEST_RATE = 1000  # samples per second of a file; at a lower one a small file would fill the memory at RATE
CACHED = 200  # utterances
TIMEOUT = 20.0  # s of wall time for espeak-ng


class SoundError(Exception):
    """A sound that cannot be made; the text says why."""


class SoundStopped(SoundError):
    """A synthesis that was stopped."""


class StopSound(threading.Event):
    """Set from another thread, it ends a running synthesis and all waits for it."""

    def __init__(self) -> None:
        super().__init__()
        self._handing = threading.Lock()  # held while the process changes, or is killed
        self._process: Optional[subprocess.Popen[bytes]] = None

    def set(self) -> None:
        """Ends the synthesis."""
        super().set()
        with self._handing:
            if self._process is not None:
                self._process.kill()

    def attach(self, process: "Optional[subprocess.Popen[bytes]]") -> None:
        """Says which process is to be ended."""
        with self._handing:
            self._process = process
            if process is not None and self.is_set():
                process.kill()


@dataclass(frozen=True)
class Sound:
    """Samples (int16, mono, RATE per second)."""

    samples: np.ndarray

    @property
    def duration(self) -> float:
        """How long it lasts, s."""
        return len(self.samples) / RATE

    def scaled(self, volume: float) -> "Sound":
        """The same sound at a volume of 0 to 1."""
        return Sound((self.samples * max(0.0, min(1.0, volume))).astype(np.int16))


class SpeechSynthesizer:
    """espeak-ng, with a memory of what it said before. Safe to use from several threads.

    :param voice: used when none is named.
    :param speed: words per minute.
    """

    def __init__(self, voice: str = "en-us", speed: int = 160) -> None:
        self.voice = voice
        self._speed = speed
        self._lock = threading.Lock()  # guards the cache
        self._cache: OrderedDict[Tuple[str, str], Sound] = OrderedDict()

    def say(self, text: str, voice: str = "", stop: Optional[StopSound] = None) -> Sound:
        """The sound of a text.

        :raises SoundError: no text, no espeak-ng, or an unknown voice.
        :raises SoundStopped: `stop` was set before the sound was made.
        """
        key = (text.strip(), voice or self.voice)
        if not key[0]:
            raise SoundError("there is no text to say")
        if "\0" in key[1]:
            raise SoundError(f"{key[1]!r} is not a name of a voice")
        with self._lock:
            if key in self._cache:
                self._cache.move_to_end(key)
                return self._cache[key]
        sound = self._synthesize(*key, stop or StopSound())
        with self._lock:
            self._cache[key] = sound
            while len(self._cache) > CACHED:
                self._cache.popitem(last=False)
        return sound

    def _synthesize(self, text: str, voice: str, stop: StopSound) -> Sound:
        # --stdin: a text that begins with a dash is not an option.
        command = ["espeak-ng", "-v", voice, "-s", str(self._speed), "--stdout", "--stdin"]
        try:
            code, sound, said = _run(command, text.encode(), stop)
        except FileNotFoundError as error:
            raise SoundError("espeak-ng is not installed (apt install espeak-ng)") from error
        except OSError as error:
            raise SoundError(f"espeak-ng cannot be started: {error.strerror}") from error
        except subprocess.TimeoutExpired as error:
            raise SoundError(f"espeak-ng took longer than {TIMEOUT:.0f} s") from error
        if stop.is_set():
            raise SoundStopped("stopped before the sound was made")
        if code != 0:
            lines = said.decode(errors="replace").strip().splitlines()
            why = lines[-1] if lines else "it gave no reason"
            raise SoundError(f"espeak-ng cannot say it with voice {voice!r}: {why}")
        return read_wave("what espeak-ng says", io.BytesIO(sound))


def _run(command: List[str], text: bytes, stop: StopSound) -> Tuple[int, bytes, bytes]:
    """Runs a program to its end, or until it is stopped; its exit code, its output and its complaints."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe) as process:
        stop.attach(process)
        try:
            output, said = process.communicate(text, timeout=TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            raise
        finally:
            stop.attach(None)
        return process.returncode, output, said


def read_wave(path: str, content: Optional[BinaryIO] = None) -> Sound:
    """Reads a WAV file of 16-bit samples, any rate and number of channels.

    :param content: of a file that is on no disk; `path` is what errors call it.
    :raises SoundError: when it is missing or of another kind, or has a rate below `LOWEST_RATE`.
    """
    if content is None and os.path.exists(path) and not os.path.isfile(path):
        raise SoundError(f"{path} is not a file")  # from a pipe it may never come
    try:
        with wave.open(content or path) as file:
            if file.getsampwidth() != 2:
                raise SoundError(f"{path}: {8 * file.getsampwidth()}-bit samples; only 16-bit WAV is played")
            rate, channels = file.getframerate(), file.getnchannels()
            frames = file.readframes(file.getnframes())
    except OSError as error:
        raise SoundError(f"{path}: {error.strerror}") from error
    except (wave.Error, EOFError, ValueError) as error:
        raise SoundError(f"{path!r} is not a WAV file: {error}") from error
    if rate < LOWEST_RATE:
        raise SoundError(f"{path}: {rate} samples per second; a sound has at least {LOWEST_RATE}")
    # A file that was cut off ends anywhere.
    data = np.frombuffer(frames[: len(frames) // (2 * channels) * (2 * channels)], dtype="<i2")
    samples = resampled(data.reshape(-1, channels).mean(axis=1), rate)
    if not len(samples):
        raise SoundError(f"{path} contains no sound")
    return Sound(samples)


def resampled(samples: np.ndarray, rate: int) -> np.ndarray:
    """Samples of another rate at RATE, by cutting or padding the spectrum."""
    wanted = round(len(samples) * RATE / rate)
    if rate == RATE or not wanted:
        return samples[:wanted].astype(np.int16)
    spectrum = np.fft.rfft(samples)
    changed = np.zeros(wanted // 2 + 1, dtype=complex)
    kept = min(len(spectrum), len(changed))
    changed[:kept] = spectrum[:kept]
    result = np.fft.irfft(changed, wanted) * (wanted / len(samples))
    return np.clip(result, -32768, 32767).astype(np.int16)


def beep(number: int) -> Sound:
    """One of the built-in sounds of sound_play, 1 to 5: one melody each.

    :raises SoundError: any other number.
    """
    tones = {1: (440, 440), 2: (660, 880), 3: (880, 660), 4: (660, 880, 660, 880), 5: (880, 660, 880, 660)}
    if number not in tones:
        raise SoundError(f"there is no built-in sound {number}")
    time = np.arange(round(0.2 * RATE)) / RATE
    fade = np.minimum(1.0, np.minimum(time, time[::-1]) / 0.01)
    parts = [12000 * fade * np.sin(2 * np.pi * tone * time) for tone in tones[number]]
    return Sound(np.concatenate(parts).astype(np.int16))
