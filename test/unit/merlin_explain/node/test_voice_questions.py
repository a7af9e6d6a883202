# SPDX-License-Identifier: Apache-2.0
"""Questions that are asked aloud: their phrases, and what of an answer is said."""

from typing import Any

import pytest
from merlin_msgs.msg import Claim
from merlin_msgs.srv import ExplainResponse

from merlin_explain.node.voice_questions import PHRASES, questions_of, spoken
from merlin_reactive.listening.speech_recognizer import available, unknown_words
from merlin_ros.parameters import ParameterError


def test_each_phrase_asks_one_question() -> None:
    found = questions_of({**PHRASES, "failed": ["what went wrong"]})
    assert found["why"] == "why" and found["when do you come"] == "when"
    assert found["what went wrong"] == "failed"


@pytest.mark.skipif(not available(), reason="no recogniser")
def test_the_recogniser_knows_the_words_of_the_phrases() -> None:
    words = [word for phrases in PHRASES.values() for phrase in phrases for word in phrase.split()]
    assert unknown_words(words) == ""


@pytest.mark.parametrize(
    ("phrases", "said"),
    [
        ("why", "phrases of why, doing"),
        ({"whither": ["whither"]}, "phrases of why, doing"),
        ({"why": "why"}, "not a list of phrases"),
        ({"why": []}, "not a list of phrases"),
        ({"why": ["Why?"]}, "words in lower case"),
        ({"why": [True]}, "words in lower case"),
        ({"why": ["go on"], "doing": ["go on"]}, "'go on' asks why and doing"),
    ],
)
def test_phrases_that_cannot_be_used_are_named(phrases: Any, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        questions_of(phrases)


def test_the_first_sentence_is_said_and_when_it_ends() -> None:
    long = "Navigating to the kitchen for “kitchen checked”. It is expected to end at 15:06:44; 3.5 s late."
    claims = [Claim(kind="doing", text="x"), Claim(kind="estimate", text="it is expected to end at 15:06:44")]
    answer = ExplainResponse(True, long, claims)
    assert spoken("doing", answer) == "Navigating to the kitchen for kitchen checked."
    assert spoken("when", answer) == "It is expected to end at 15:06:44"
    assert spoken("when", ExplainResponse(True, "Nothing is done.", [])) == "Nothing is done."
    assert spoken("why", ExplainResponse(False, "nothing runs now; name a step", [])) == ""
