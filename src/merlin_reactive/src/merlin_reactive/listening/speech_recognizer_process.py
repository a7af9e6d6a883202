"""The speech recogniser in a process of its own.

The decoder keeps Python's interpreter lock for as long as it decodes, a second for two seconds of speech.
In the node's own process nothing else would run meanwhile: no status, no answer to a cancel, and on a busy
machine the clients of the node would take it for dead.
"""

import os
import pickle
import subprocess
import sys
import threading
from typing import Any, BinaryIO, Optional, Union

import numpy as np

from merlin_reactive.listening.speech_recognizer import (
    THRESHOLD,
    GrammarError,
    SpeechRecognizer,
    Understanding,
)

END_LIMIT = 1.0  # s of wall time for the process to end by itself


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
        self._process: Optional[subprocess.Popen[bytes]] = self._start()

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

    def close(self) -> None:
        """Ends the process, also one that is decoding."""
        self._closed = True
        process = self._process
        if process is not None and process.poll() is None:
            process.terminate()
            try:
                process.wait(END_LIMIT)
            except subprocess.TimeoutExpired:
                process.kill()

    def _start(self) -> "subprocess.Popen[bytes]":
        command = [
            sys.executable,
            "-m",
            "merlin_reactive.listening.speech_recognizer_process",
            str(self._threshold),
        ]
        # In a session of its own, where no Ctrl-C reaches it: the node that started it ends it.
        return subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )

    def _call(self, request: Any) -> Any:
        if self._closed:
            raise SpeechRecognizerLost("the speech recogniser is shut down")
        process = self._process = self._process or self._start()
        assert process.stdin is not None and process.stdout is not None  # both are pipes
        try:
            _write(process.stdin, request)
            answer = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            self._process = None
            process.kill()
            raise SpeechRecognizerLost(
                f"the speech recogniser's process ended (exit code {process.wait()})"
            ) from error
        if isinstance(answer, GrammarError):
            raise answer
        return answer


def _write(stream: Any, value: Any) -> None:
    pickle.dump(value, stream)
    stream.flush()


def serve(requests: BinaryIO, answers: BinaryIO, recognizer: SpeechRecognizer) -> None:
    """Answers requests, a grammar or the samples of an utterance, until there are no more."""
    while True:
        try:
            request = pickle.load(requests)
        except EOFError:
            return
        answer: Union[Understanding, GrammarError, None] = None
        try:
            if isinstance(request, str):
                recognizer.use(request)
            else:
                answer = recognizer.understand(request)
        except GrammarError as error:
            answer = error
        try:
            _write(answers, answer)
        except BrokenPipeError:
            return  # the node has closed its end


def main() -> None:
    """The process: serves its standard input and output."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is not an answer
    serve(sys.stdin.buffer, answers, SpeechRecognizer(float(sys.argv[1])))


if __name__ == "__main__":
    main()
