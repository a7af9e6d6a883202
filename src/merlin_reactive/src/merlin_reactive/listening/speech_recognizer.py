# SPDX-License-Identifier: Apache-2.0
"""Understands speech: pocketsphinx with a JSGF grammar, and the courage to say that it did not understand."""

import functools
import importlib
import importlib.util
import threading
from dataclasses import dataclass
from typing import Any, FrozenSet, List, Optional, Sequence, Tuple

import numpy as np

# A grammar alone turns every sound into one of its sentences. A free sequence of phones fits sounds that are
# not in the grammar better than the grammar does: the score difference per frame decides. Measured (see
# docs/simulation.md), nine of ten good sentences lie above this, and all but a few of the others below.
THRESHOLD = 0.00002
CERTAIN = 0.0006  # margin over the threshold from which an answer counts as certain
# What a grammar has no words for, the decoder also likes to take for silence.
UNEXPLAINED = 0.2  # share of the loud frames that the best sentence may leave to silence
LOUD = 0.15  # of the loudest twentieth of the frames, from which a frame is loud
FRAME = 160  # samples of one frame of the decoder
DITHER = 20.0  # standard deviation of the noise that is added, of 32767
PADDING = 0.25  # s of silence around an utterance; the decoder wants some
RATE = 16000  # samples per second
SOUND_FRAME = RATE // 50  # samples whose loudness is looked at together
QUIET_FRAMES = 30  # of them, quiet, that end an utterance: 0.6 s
LIBRARY = "pocketsphinx"  # which pip does not have for each Python and processor
MISSING = (
    f"no {LIBRARY}, so nothing that is said can be understood here: install one that fits this Python, "
    "run listen on another computer, or start without it (docs/platforms.md)"
)


def available() -> bool:
    """Whether the decoder's library is installed."""
    return importlib.util.find_spec(LIBRARY) is not None


class GrammarError(Exception):
    """A grammar that cannot be used; the text says why."""


@dataclass(frozen=True)
class Understanding:
    """What was understood: text empty when nothing was; confidence 0 to 1."""

    text: str
    confidence: float


@functools.lru_cache(maxsize=None)
def _dictionary() -> FrozenSet[str]:
    library = importlib.import_module(LIBRARY)
    with open(f"{library.get_model_path('en-us')}/cmudict-en-us.dict", encoding="utf-8") as lines:
        return frozenset(line.split(" ", 1)[0] for line in lines)


def unknown_words(words: Sequence[str]) -> str:
    """What is wrong with words of a grammar; empty: the dictionary has all of them."""
    if not available():
        return MISSING
    known = _dictionary()
    missing = [word for word in dict.fromkeys(words) if word not in known]
    if not missing:
        return ""
    return f"no {' and no '.join(map(repr, missing))} in its English dictionary, which is in lower case"


class SpeechRecognizer:
    """Decodes utterances; 16 kHz, mono. Safe to use from several threads, one utterance at a time.

    :param threshold: margin per frame below which an utterance is rejected.
    """

    def __init__(self, threshold: float = THRESHOLD) -> None:
        self._threshold = threshold
        self._lock = threading.Lock()  # the decoder has one state
        library = importlib.import_module(LIBRARY)
        model = library.get_model_path("en-us")
        self._decoder = library.Decoder(
            library.Config(
                hmm=f"{model}/en-us", dict=f"{model}/cmudict-en-us.dict", lm=None, loglevel="FATAL"
            )
        )
        self._decoder.add_allphone_file("phones", f"{model}/en-us-phone.lm.bin")
        self._grammar: Optional[str] = None

    def use(self, grammar: str) -> None:
        """Sets the grammar (JSGF text) for the next utterances.

        :raises GrammarError: it is empty, malformed, or has words that the dictionary lacks.
        """
        if not grammar.strip():
            raise GrammarError("the grammar is empty")
        with self._lock:
            if grammar == self._grammar:
                return
            self._grammar = None
            try:
                self._decoder.add_jsgf_string("grammar", grammar)
            except (RuntimeError, ValueError) as error:
                raise GrammarError(
                    f"the grammar cannot be used (JSGF? words of the English dictionary?): {error}"
                ) from error
            self._grammar = grammar

    def understand(self, samples: np.ndarray) -> Understanding:
        """What an utterance (int16) says.

        :raises GrammarError: when no grammar was set.
        """
        text, margin, unexplained = self.hypothesis(samples)
        if not text or margin < self._threshold or unexplained > UNEXPLAINED:
            return Understanding("", 0.0)
        return Understanding(text, min(1.0, 0.5 + 0.5 * (margin - self._threshold) / CERTAIN))

    def hypothesis(self, samples: np.ndarray) -> Tuple[str, float, float]:
        """The sentence that fits best, and how well.

        Returns it with how much better it does than mere phones, per frame, and the share of what is loud
        that it does not account for.
        """
        silence = np.zeros(round(PADDING * RATE))
        audio = np.concatenate([silence, samples, silence])
        # Digital silence has no spectrum to take the logarithm of.
        audio = audio + DITHER * np.random.default_rng(0).standard_normal(len(audio))
        data = np.clip(audio, -32768, 32767).astype("<i2").tobytes()
        with self._lock:
            if self._grammar is None:
                raise GrammarError("there is no grammar")
            said, frames = self._search("grammar", data)
            # Of an utterance that breaks off, the decoder returns the beginning of a sentence.
            if said is None or not self._decoder.get_fsg("grammar").accept(said.hypstr):
                return "", 0.0, 1.0
            silent = [
                (segment.start_frame, segment.end_frame + 1)
                for segment in self._decoder.seg()
                if segment.word.startswith(("<", "[", "+"))
            ]
            phones, _ = self._search("phones", data)
        if phones is None:
            return "", 0.0, 1.0
        margin = (said.score - phones.score) / max(frames, 1)
        return str(said.hypstr), margin, _unexplained(audio, silent)

    def _search(self, name: str, audio: bytes) -> Tuple[Any, int]:
        self._decoder.activate_search(name)
        self._decoder.start_utt()
        self._decoder.process_raw(audio, no_search=False, full_utt=True)
        self._decoder.end_utt()
        return self._decoder.hyp(), self._decoder.n_frames()


def _unexplained(audio: np.ndarray, silent: List[Tuple[int, int]]) -> float:
    """Share of the loud frames that lie in spans, in frames, which are taken for silent."""
    frames = audio[: len(audio) // FRAME * FRAME].reshape(-1, FRAME)
    levels = np.sqrt(np.mean(np.square(frames), axis=1))
    loud = levels > LOUD * np.percentile(levels, 95)
    inside = np.zeros(len(loud), dtype=bool)
    for first, end in silent:
        inside[first:end] = True
    return float(np.mean(inside[loud])) if loud.any() else 0.0


class UtteranceDetector:
    """Cuts an utterance out of a stream of sound, by its loudness.

    :param loud: RMS of a frame, of 32767, that counts as speech.
    :param longest: s after which it ends although it is not quiet, as beside a fan.
    """

    def __init__(self, loud: float = 400.0, longest: float = 15.0) -> None:
        self._most_frames = round(longest * RATE / SOUND_FRAME)
        self._loud = loud
        self._rest = np.zeros(0, dtype=np.int16)
        self._frames: List[np.ndarray] = []
        self._quiet = 0
        self.speaking = False

    def feed(self, samples: np.ndarray) -> Optional[np.ndarray]:
        """Takes sound as it comes; returns the utterance when one has ended."""
        samples = np.concatenate([self._rest, samples])
        whole = len(samples) // SOUND_FRAME * SOUND_FRAME
        self._rest = samples[whole:]
        for frame in samples[:whole].reshape(-1, SOUND_FRAME):
            loud = float(np.sqrt(np.mean(np.square(frame.astype(float))))) > self._loud
            if loud:
                self.speaking, self._quiet = True, 0
            if self.speaking:
                self._frames.append(frame)
                self._quiet += not loud
                if self._quiet >= QUIET_FRAMES or len(self._frames) >= self._most_frames:
                    return self.finish()
        return None

    def finish(self) -> Optional[np.ndarray]:
        """Ends the utterance now; None when there is no speech."""
        frames, self._frames = self._frames, []
        self.speaking, self._quiet = False, 0
        return np.concatenate(frames) if frames else None
