# SPDX-License-Identifier: Apache-2.0
"""Understanding synthesised speech, and not understanding what no grammar allows."""

import numpy as np
import pytest

from merlin_reactive.listening.speech_recognizer import GrammarError, SpeechRecognizer, UtteranceDetector
from merlin_reactive.speech.speech_synthesizer import SpeechSynthesizer

GRAMMAR = """#JSGF V1.0; grammar answer;
public <answer> = (yes | no) [please | thank you] | bring me a (coffee | tea) [please];"""


@pytest.fixture(scope="module")
def recognizer():
    recognizer = SpeechRecognizer()
    recognizer.use(GRAMMAR)
    return recognizer


@pytest.fixture(scope="module")
def synthesizer():
    return SpeechSynthesizer()


@pytest.mark.parametrize("text", ["yes please", "no thank you", "bring me a tea please"])
@pytest.mark.parametrize("voice", ["en-us", "en-us+f3"])
def test_what_the_grammar_allows_is_understood(recognizer, synthesizer, text, voice):
    said = recognizer.understand(synthesizer.say(text, voice).samples)
    assert said.text == text
    assert 0.5 <= said.confidence <= 1.0


@pytest.mark.parametrize("text", ["the weather is nice today", "i have a big dog at home", "seven"])
def test_other_sentences_are_rejected(recognizer, synthesizer, text):
    assert recognizer.understand(synthesizer.say(text).samples).text == ""


def test_an_answer_accounts_for_all_that_was_said(recognizer, synthesizer):
    # The words that the grammar lacks could pass for silence before an answer.
    recognizer.use("#JSGF V1.0; grammar g; public <answer> = (yes | no) [please | thank you];")
    try:
        assert recognizer.understand(synthesizer.say("no please", "en-gb").samples).text == "no please"
        assert recognizer.understand(synthesizer.say("bring me a coffee", "en-gb").samples).text == ""
    finally:
        recognizer.use(GRAMMAR)


def test_the_beginning_of_a_sentence_is_no_sentence(recognizer, synthesizer):
    drinks = [f"bring me a {drink}{end}" for drink in ("coffee", "tea") for end in ("", " please")]
    sound = synthesizer.say("bring me a coffee please", "en-us").samples
    pause = np.zeros(4000, dtype=np.int16)
    for share in np.linspace(0.25, 0.6, 15):
        cut = np.concatenate([sound[: int(share * len(sound))], pause])
        assert recognizer.understand(cut).text in ("", *drinks)


def test_noise_is_no_sentence(recognizer):
    noise = (1000 * np.random.default_rng(1).standard_normal(16000)).astype(np.int16)
    assert recognizer.understand(noise).text == ""


def test_bad_grammars(recognizer):
    for grammar in ("", "nonsense", "#JSGF V1.0; grammar g; public <g> = qwrtzp;"):
        with pytest.raises(GrammarError):
            recognizer.use(grammar)
    recognizer.use(GRAMMAR)


def test_an_utterance_is_cut_out_of_a_stream():
    detector = UtteranceDetector()
    tone = (8000 * np.sin(np.arange(8000) / 5)).astype(np.int16)
    assert detector.feed(np.zeros(16000, dtype=np.int16)) is None
    assert detector.feed(tone) is None and detector.speaking
    found = detector.feed(np.zeros(16000, dtype=np.int16))
    assert len(tone) <= len(found) <= len(tone) + 0.7 * 16000
    assert detector.finish() is None


def test_noise_that_does_not_end_is_cut_off():
    detector = UtteranceDetector(longest=2.0)
    noise = (8000 * np.sin(np.arange(16000) / 5)).astype(np.int16)
    assert detector.feed(noise) is None
    found = detector.feed(noise)
    assert len(found) == 2 * 16000 and not detector.speaking
