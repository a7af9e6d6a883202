# SPDX-License-Identifier: Apache-2.0
"""Questions that are asked aloud: their phrases, and what of an answer is said."""

from typing import Any, List, Tuple

import genpy
import pytest
from merlin_msgs.msg import Claim, Evidence
from merlin_msgs.srv import ExplainRequest, ExplainResponse

from merlin_explain.node.voice_questions import PHRASES, asked, questions_of, spoken
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
    end = Evidence(kind="request", time=genpy.Time(500))
    claims = [Claim(kind="doing", text="x"), Claim("estimate", "it is expected to end at 15:06:44", [end])]
    answer = ExplainResponse(True, long, claims)
    assert spoken("doing", answer, 470.0) == "Navigating to the kitchen for kitchen checked."
    for now, said in (
        (470.4, "I will be ready in about 30 seconds."),
        (200.0, "I will be ready in about 5 minutes."),
        (520.0, "I wanted to be ready 20 seconds ago."),
    ):
        assert spoken("when", answer, now) == said
    unknown = [Claim("estimate", "when it ends is not known: there is no plan yet", [Evidence()])]
    assert spoken("when", ExplainResponse(True, long, unknown), 1.0).startswith("When it ends is not known")
    assert spoken("when", ExplainResponse(True, "Nothing is done.", []), 1.0) == "Nothing is done."
    assert spoken("why", ExplainResponse(False, "nothing runs now; name a step", []), 1.0) == ""


def running(text: str, words: str) -> Claim:
    return Claim("running", f"“{words}” has run since 15:06:11", [Evidence(kind="step", text=text)])


def test_of_two_robots_the_one_that_is_asked_answers_of_itself() -> None:
    steps = [running("(navigate ann hall kitchen)", "ann drives"), running("(ask bob_2 attic)", "bob_2 asks")]
    requests: List[Tuple[str, str]] = []

    def explain(request: ExplainRequest) -> ExplainResponse:
        requests.append((request.question, request.about))
        return ExplainResponse(True, f"{request.question} {request.about}.", steps)

    assert spoken("doing", asked("doing", "bob_2", explain), 0.0) == "Bob 2 asks."
    assert asked("why", "bob_2", explain).sentence == "why (ask bob_2 attic)."
    assert asked("why", "ann", explain).sentence == "why (navigate ann hall kitchen)."
    assert asked("why", "bob", explain).sentence == "bob does nothing now."
    requests.clear()
    assert asked("when", "bob_2", explain).ok and asked("why", "", explain).ok
    assert requests == [("doing", ""), ("why", "")]
    silent = ExplainResponse(False, "the monitor has recorded nothing for 9 s", [])
    assert asked("doing", "ann", lambda _: silent) == silent
