"""The recogniser in a process of its own: understands the same, stops nobody, and survives its process."""

import os
import signal
import threading
import time
from typing import Iterator, List

import numpy as np
import pytest

from merlin_reactive.listening.speech_recognizer import GrammarError
from merlin_reactive.listening.speech_recognizer_process import SpeechRecognizerLost, SpeechRecognizerProcess
from merlin_reactive.speech.speech_synthesizer import SpeechSynthesizer

GRAMMAR = "#JSGF V1.0; grammar g; public <order> = [a] (coffee | sandwich) and [a] (coffee | cake) please;"


@pytest.fixture(scope="module")
def recognizer() -> Iterator[SpeechRecognizerProcess]:
    process = SpeechRecognizerProcess()
    yield process
    process.close()


@pytest.fixture(scope="module")
def order() -> np.ndarray:
    return SpeechSynthesizer().say("a sandwich and a coffee please").samples


def test_it_understands(recognizer: SpeechRecognizerProcess, order: np.ndarray) -> None:
    recognizer.use(GRAMMAR)
    assert recognizer.understand(order).text == "a sandwich and a coffee please"


def test_a_bad_grammar_is_said(recognizer: SpeechRecognizerProcess) -> None:
    with pytest.raises(GrammarError, match="the grammar is empty"):
        recognizer.use(" ")


def test_other_threads_go_on_while_it_decodes(recognizer: SpeechRecognizerProcess, order: np.ndarray) -> None:
    recognizer.use(GRAMMAR)
    gaps: List[float] = []
    done = threading.Event()

    def beat() -> None:
        last = time.monotonic()
        while not done.wait(0.01):
            gaps.append(time.monotonic() - last)
            last += gaps[-1]

    heart = threading.Thread(target=beat, name="heart")
    heart.start()
    begun = time.monotonic()
    recognizer.understand(np.concatenate([order, order]))
    took = time.monotonic() - begun
    done.set()
    heart.join()
    assert max(gaps) < 0.5 * took, "the decoder kept the interpreter to itself"


def test_a_process_that_dies_is_named_and_replaced(
    recognizer: SpeechRecognizerProcess, order: np.ndarray
) -> None:
    recognizer.use(GRAMMAR)
    os.kill(recognizer._process.pid, signal.SIGKILL)
    with pytest.raises(SpeechRecognizerLost, match="exit code -9"):
        recognizer.understand(order)
    assert recognizer.understand(order).text, "the grammar is remembered"


def test_after_the_end_nothing_is_started(recognizer: SpeechRecognizerProcess, order: np.ndarray) -> None:
    process = recognizer._process
    recognizer.close()
    assert process.poll() is not None
    with pytest.raises(SpeechRecognizerLost, match="shut down"):
        recognizer.understand(order)
