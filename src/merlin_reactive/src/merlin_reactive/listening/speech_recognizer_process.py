# SPDX-License-Identifier: Apache-2.0
"""The speech recogniser in a process of its own.

The decoder keeps Python's interpreter lock for as long as it decodes, a second for two seconds of speech.
In the node's own process nothing else would run meanwhile: no status, no answer to a cancel, and on a busy
machine the clients of the node would take it for dead.
"""

import contextlib
import socket
import sys
import threading
from typing import Any, Optional, Union

import numpy as np

from merlin_reactive.listening.speech_recognizer import (
    THRESHOLD,
    GrammarError,
    SpeechRecognizer,
    Understanding,
)
from merlin_ros.processes.child_process import ChildProcess, parent, receive, send

#: s of wall time without an answer after which the process counts as hung, and is replaced.
HANGS = 60.0
_MODULE = "merlin_reactive.listening.speech_recognizer_process"


class SpeechRecognizerLost(Exception):
    """The process ended before it answered; the next call starts another one."""


class SpeechRecognizerProcess:
    """A :class:`SpeechRecognizer` elsewhere. Safe to use from several threads, one call at a time.

    :param threshold: of the recogniser.
    """

    def __init__(self, threshold: float = THRESHOLD) -> None:
        self._threshold = threshold
        self._lock = threading.Lock()  # guards what follows
        self._grammar = ""
        self._closed = False
        self._process: Optional[ChildProcess] = self._begun()

    def use(self, grammar: str) -> None:
        """Sets the grammar (JSGF text) for the next utterances.

        :raises GrammarError: as :meth:`SpeechRecognizer.use`.
        :raises SpeechRecognizerLost: the process ended.
        """
        with self._lock:
            self._call(grammar)
            self._grammar = grammar

    def understand(self, samples: np.ndarray) -> Understanding:
        """What an utterance (int16) says.

        :raises GrammarError: when no grammar was set.
        :raises SpeechRecognizerLost: the process ended.
        """
        with self._lock:
            if self._process is None and self._grammar:
                self._call(self._grammar)
            understanding: Understanding = self._call(np.asarray(samples, dtype=np.int16))
            return understanding

    @property
    def pid(self) -> int:
        """Process id of the recogniser; 0: none runs."""
        process = self._process
        return process.pid if process is not None else 0

    def close(self) -> None:
        """Ends the process, also one that is decoding."""
        self._closed = True
        process = self._process
        if process is not None:
            process.kill()

    def _begun(self) -> ChildProcess:
        process = ChildProcess(_MODULE, str(self._threshold))
        process.channel.settimeout(HANGS)
        return process

    def _call(self, request: Any) -> Any:
        if self._closed:
            raise SpeechRecognizerLost("the speech recogniser is shut down")
        process = self._process = self._process or self._begun()
        try:
            send(process.channel, request)
            answer = receive(process.channel)
        except (OSError, EOFError) as error:
            self._process = None
            raise SpeechRecognizerLost(
                f"the speech recogniser's process ended (exit code {process.kill()})"
            ) from error
        if isinstance(answer, GrammarError):
            raise answer
        return answer


def serve(channel: socket.socket, recognizer: SpeechRecognizer) -> None:
    """Answers requests, a grammar or the samples of an utterance, until the other end closes."""
    while True:
        request = receive(channel)
        answer: Union[Understanding, GrammarError, None] = None
        try:
            if isinstance(request, str):
                recognizer.use(request)
            else:
                answer = recognizer.understand(request)
        except GrammarError as error:
            answer = error
        send(channel, answer)


def main() -> None:
    """Entry point of the process; its first argument is the threshold."""
    with parent() as channel, contextlib.suppress(EOFError, OSError):
        serve(channel, SpeechRecognizer(float(sys.argv[1])))
