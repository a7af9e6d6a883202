# SPDX-License-Identifier: Apache-2.0
"""The recogniser in a process of its own: understands the same, blocks no thread, survives its process."""

import os
import signal
import threading
from pathlib import Path
from typing import Iterator, List

import numpy as np
import pytest

from merlin_reactive.listening.speech_recognizer import GrammarError
from merlin_reactive.listening.speech_recognizer_process import SpeechRecognizerLost, SpeechRecognizerProcess
from merlin_reactive.speech.speech_synthesizer import SpeechSynthesizer
from merlin_test.process_signals import hang

pytestmark = pytest.mark.processes

LONG = 100.0  # s
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
    understood: List[str] = []
    caller = threading.Thread(
        target=lambda: understood.append(recognizer.understand(order).text), daemon=True
    )
    process = recognizer.pid
    hang(process)
    try:
        caller.start()
        caller.join(1.0)
        assert caller.is_alive() and not understood, "it decodes in that process"
    finally:  # this thread goes on meanwhile, or it would not come here
        os.kill(process, signal.SIGCONT)
    caller.join(LONG)
    assert understood == ["a sandwich and a coffee please"]


def test_a_process_that_dies_is_named_and_replaced(
    recognizer: SpeechRecognizerProcess, order: np.ndarray
) -> None:
    recognizer.use(GRAMMAR)
    os.kill(recognizer.pid, signal.SIGKILL)
    with pytest.raises(SpeechRecognizerLost, match="exit code -9"):
        recognizer.understand(order)
    assert recognizer.understand(order).text, "the grammar is remembered"


def test_after_the_end_nothing_is_started(recognizer: SpeechRecognizerProcess, order: np.ndarray) -> None:
    process = recognizer.pid
    recognizer.close()
    assert not Path(f"/proc/{process}").exists()
    with pytest.raises(SpeechRecognizerLost, match="shut down"):
        recognizer.understand(order)


WITHOUT_LIBRARY = """
import sys
sys.modules["pocketsphinx"] = None  # as where pip has none: docs/platforms.md
from merlin_reactive.listening.listen_node import main
from merlin_reactive.listening.speech_recognizer import unknown_words
print(unknown_words(["coffee"]), flush=True)
sys.exit(main())
"""


def test_without_its_library_the_node_ends_with_a_sentence(master) -> None:
    node = master.node(WITHOUT_LIBRARY)
    assert node.ended() == 2
    checked, said = [line for line in node.output.splitlines() if "no pocketsphinx, so nothing" in line]
    assert checked.startswith("no pocketsphinx") and "/listen: there is no pocketsphinx" in said
    assert "Traceback" not in node.output
