# SPDX-License-Identifier: Apache-2.0
"""Sounds: true lengths, rates, errors."""

import os
import subprocess
import tempfile
import threading
import wave
from unittest.mock import MagicMock

import numpy as np
import pytest

from merlin_reactive.speech.speech_synthesizer import (
    RATE,
    Sound,
    SoundError,
    SoundStopped,
    SpeechSynthesizer,
    StopSound,
    beep,
    read_wave,
    resampled,
)
from merlin_test import LONG


@pytest.fixture(scope="module")
def synthesizer():
    return SpeechSynthesizer()


def test_longer_texts_last_longer_and_are_remembered(synthesizer):
    short, long = synthesizer.say("Yes."), synthesizer.say("Yes, please bring me a cup of coffee.")
    assert 0.2 < short.duration < long.duration < 5.0
    assert np.abs(long.samples).max() > 3000
    assert synthesizer.say(" Yes. ") is short


def test_a_text_is_no_option(synthesizer):
    assert synthesizer.say("--version").duration > 0.3


@pytest.mark.parametrize(("text", "voice"), [("", ""), ("  ", ""), ("hello", "xx-none")])
def test_what_cannot_be_said(synthesizer, text, voice):
    with pytest.raises(SoundError):
        synthesizer.say(text, voice)


def test_it_speaks_where_no_file_can_be_written(synthesizer, monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    assert synthesizer.say("the disk is full").duration > 0.3


def test_a_system_that_starts_no_process_is_no_end_of_the_speaker(synthesizer, monkeypatch):
    monkeypatch.setattr(subprocess, "Popen", MagicMock(side_effect=OSError(24, "Too many open files")))
    with pytest.raises(SoundError, match="Too many open files"):
        synthesizer.say("what nothing can say")


def test_a_pipe_is_no_file_to_wait_for(tmp_path):
    """What writes into it may never come, and the speaker says nothing else meanwhile."""
    os.mkfifo(tmp_path / "pipe")
    ended = threading.Thread(target=lambda: said.append(said_of(str(tmp_path / "pipe"))), daemon=True)
    said = []
    ended.start()
    ended.join(LONG / 10)
    assert said == [f"{tmp_path}/pipe is not a file"]


def said_of(path):
    with pytest.raises(SoundError) as caught:
        read_wave(path)
    return str(caught.value)


def test_a_long_text_is_stopped_while_it_is_made(synthesizer):
    stop, ended = StopSound(), []

    def speak():
        try:
            synthesizer.say("word " * 50000, stop=stop)
        except SoundStopped as error:
            ended.append(error)

    speaker = threading.Thread(target=speak, name="speaker")
    speaker.start()
    while stop._process is None and speaker.is_alive():
        speaker.join(0.01)
    stop.set()
    speaker.join(100.0)  # without the stop it takes a minute, or ends by a time-out
    assert len(ended) == 1
    with pytest.raises(SoundStopped):
        synthesizer.say("not said before", stop=stop)


def test_files_are_played_at_the_common_rate(tmp_path):
    file = tmp_path / "tone.wav"
    time = np.arange(44100) / 44100
    tone = (8000 * np.sin(2 * np.pi * 440 * time)).astype("<i2")
    with wave.open(str(file), "wb") as out:
        out.setnchannels(2)
        out.setsampwidth(2)
        out.setframerate(44100)
        out.writeframes(np.repeat(tone, 2).tobytes())
    sound = read_wave(str(file))
    assert sound.duration == pytest.approx(1.0)
    peak = np.argmax(np.abs(np.fft.rfft(sound.samples)))
    assert peak * RATE / len(sound.samples) == pytest.approx(440, abs=2)


def test_of_a_file_that_was_cut_off_the_rest_is_played(tmp_path):
    file = tmp_path / "half.wav"
    with wave.open(str(file), "wb") as out:
        out.setnchannels(2)
        out.setsampwidth(2)
        out.setframerate(RATE)
        out.writeframes(bytes(4000))
    file.write_bytes(file.read_bytes()[:-2001])
    assert len(read_wave(str(file)).samples) == 499


def test_files_that_are_no_sound(tmp_path):
    file = tmp_path / "text.wav"
    file.write_text("hello")
    with pytest.raises(SoundError, match="not a WAV file"):
        read_wave(str(file))
    with wave.open(str(file), "wb") as out:
        out.setnchannels(1)
        out.setsampwidth(2)
        out.setframerate(RATE)
    with pytest.raises(SoundError, match="contains no sound"):
        read_wave(str(file))
    with wave.open(str(file), "wb") as out:
        out.setnchannels(1)
        out.setsampwidth(2)
        out.setframerate(3 * RATE)
        out.writeframes(bytes(2))  # a third of a sample at the common rate
    with pytest.raises(SoundError, match="contains no sound"):
        read_wave(str(file))
    with wave.open(str(file), "wb") as out:
        out.setnchannels(1)
        out.setsampwidth(2)
        out.setframerate(1)
        out.writeframes(bytes(200_000))  # a day
    with pytest.raises(SoundError, match="1 samples per second; a sound has at least 1000"):
        read_wave(str(file))
    with pytest.raises(SoundError, match="not a WAV file"):
        read_wave("a\0b")
    with pytest.raises(SoundError, match="No such file"):
        read_wave(str(tmp_path / "none.wav"))


def test_volume_beeps_and_rates():
    assert np.abs(beep(1).scaled(0.0).samples).max() == 0
    assert beep(3).duration == pytest.approx(0.4)
    with pytest.raises(SoundError):
        beep(9)
    assert len(resampled(np.zeros(22050), 22050)) == RATE
    assert Sound(np.zeros(RATE, dtype=np.int16)).duration == 1.0
