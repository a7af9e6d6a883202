# SPDX-License-Identifier: Apache-2.0
"""How well spoken sentences are understood, and others rejected, over voices, as a table."""

import argparse
import itertools
import sys
from typing import Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from merlin_reactive.listening.speech_recognizer import SpeechRecognizer
from merlin_reactive.seeded_random import draw
from merlin_reactive.speech.speech_synthesizer import RATE, SoundError, SpeechSynthesizer

VOICES = ("en-us", "en-us+f3", "en-gb", "en-us+m3")
ROOM = 30.0  # of 32767: RMS of the noise around a sentence, as person_voice has it


class Question(NamedTuple):
    """A grammar, sentences that it allows, and sentences that it does not."""

    name: str
    grammar: str
    allowed: Tuple[str, ...]
    others: Tuple[str, ...]


OTHERS = (
    "the weather is nice today",
    "i have a big dog at home",
    "what time is it",
    "where is the bathroom",
    "can you turn on the light",
)
QUESTIONS = (
    Question(
        "yes or no",
        "#JSGF V1.0; grammar g; public <answer> = (yes | no) [please | thank you];",
        ("yes please", "no thank you", "yes", "no"),
        (*OTHERS, "bring me a coffee"),
    ),
    Question(
        "an order",
        "#JSGF V1.0; grammar g; public <order> = [please] bring me (a | the) <thing> [please] | nothing;"
        "<thing> = coffee | glass of water | orange juice | sandwich | piece of cake;",
        (
            "bring me a coffee please",
            "please bring me the sandwich",
            "bring me a glass of water",
            "bring me the orange juice please",
            "please bring me a piece of cake",
            "nothing",
        ),
        (*OTHERS, "seven", "the food was very good"),
    ),
    Question(
        "how many",
        "#JSGF V1.0; grammar g; public <number> = (two | three | four | five) of us | i am alone;",
        ("two of us", "three of us", "four of us", "i am alone"),
        (*OTHERS, "yes please"),
    ),
)


class Tally(NamedTuple):
    """What became of sentences: shown, as it should, taken for another sentence."""

    shown: int
    right: int
    wrong: int

    def row(self) -> str:
        """For the table."""
        return f"{self.right}/{self.shown} | {self.wrong}"


def heard(text: str, voice: str, synthesizer: SpeechSynthesizer, seed: int) -> np.ndarray:
    """A sentence as a microphone has it."""
    samples = synthesizer.say(text, voice).samples
    quiet = np.zeros(round(0.2 * RATE))
    sound = np.concatenate([quiet, samples, quiet])
    noise = ROOM * draw(seed, f"{voice}/{text}", 0).standard_normal(len(sound))
    return np.clip(sound + noise, -32768, 32767).astype(np.int16)


def tallies(question: Question, voice: str, recognizer: SpeechRecognizer, seed: int) -> Iterator[Tally]:
    """What became of the sentences that are allowed, and of the others."""
    synthesizer = SpeechSynthesizer()
    recognizer.use(question.grammar)
    for texts, right in ((question.allowed, None), (question.others, "")):
        said = [recognizer.understand(heard(text, voice, synthesizer, seed)).text for text in texts]
        wanted = [text if right is None else right for text in texts]
        good = sum(map(str.__eq__, said, wanted))
        yield Tally(len(texts), good, sum(bool(text) for text in said) - (good if right is None else 0))


def main(arguments: Optional[List[str]] = None) -> int:
    """Prints the table; returns its exit code."""
    parser = argparse.ArgumentParser(prog="bench/matrices listening", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of the room's noise (default 1)")
    parser.add_argument("--voice", help="only this voice of espeak-ng")
    options = parser.parse_args(arguments)
    recognizer = SpeechRecognizer()
    print("| question | voice | understood | misunderstood | others rejected | others taken for an answer |")
    print("|---|---|---|---|---|---|")
    rows = []
    voices = [options.voice] if options.voice else VOICES
    for question, voice in itertools.product(QUESTIONS, voices):
        try:
            rows.append(tuple(tallies(question, voice, recognizer, options.seed)))
        except SoundError as error:
            print(f"listening_matrix: {error}", file=sys.stderr)
            return 1
        allowed, others = rows[-1]
        print(f"| {question.name} | {voice} | {allowed.row()} | {others.row()} |", flush=True)
    allowed, others = (Tally(*map(sum, zip(*column))) for column in zip(*rows))
    print(f"| all | | {allowed.row()} | {others.row()} |")
    return 0
