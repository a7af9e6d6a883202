# SPDX-License-Identifier: Apache-2.0
"""Grammars that cannot be used are named when their state is made; those that can are left alone."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from merlin_reactive.listening.speech_recognizer import (
    GrammarError,
    SpeechRecognizer,
    available,
    unknown_words,
)
from merlin_sm.states.jsgf import check_grammar

HEADER = "#JSGF V1.0; grammar g; "


@pytest.mark.parametrize(
    "rules",
    [
        "public <a> = yes | no;",
        "public <a> = [please] (bring | fetch) me <thing>+ | x*;"
        " <thing> = /0.3/ tea | /2/ coffee {drink = 'x;';};",
        'public <a> = "ice cream" <NULL>; // a comment\n/* another one */ <b> = don\'t | twenty-one;',
        "import <com.kitchen.food>; public <a> = <food>;",
        "import<com.kitchen.*>;; public <a> = <food>;",
    ],
)
def test_a_grammar_that_can_be_used(rules: str) -> None:
    assert isinstance(check_grammar(HEADER + rules), list)


@pytest.mark.parametrize(
    ("grammar", "said"),
    [
        ("", "line 1: it has to begin with '#JSGF"),
        ("yes or no", "line 1: it has to begin with '#JSGF"),
        (HEADER, "it has no public rule"),
        (HEADER + "<a> = yes;", "it has no public rule"),
        (HEADER + "public <a> = yes", "expected ';' at its end, found 'public <a> = yes'"),
        (HEADER + "public <a> = (yes;", "expected '\\)' at the end of the rule <a>"),
        (HEADER + "public <a> = yes | ;", "an alternative of the rule <a> is empty"),
        (HEADER + "public <a> = ;", "an alternative of the rule <a> is empty"),
        (HEADER + "public <a> yes;", "expected '<rule> = …', found 'public <a> yes'"),
        (HEADER + "\npublic <a> = <b>;", "line 2: it has no rule <b>, only <a>"),
        (HEADER + "public <a> = x; <a> = y;", "the rule <a> is defined twice"),
        (HEADER + "public <a> = * yes;", "'\\*' stands behind nothing"),
        (HEADER + "public <a> = yes {t}*;", "'\\*' stands behind nothing"),
        (HEADER + "public <a> =\n{t} yes;", "a tag stands behind nothing"),
        (HEADER + "public <a> = /1/ /2/ yes;", "a weight stands before nothing"),
        (HEADER + "public <a> = yes | no /2/;", "a weight stands before nothing"),
        (HEADER + "public <a = yes;", "expected '<rule> = …'"),
        (HEADER + "public <a> = <imported>;", "it has no rule <imported>, only <a>"),
        (HEADER + "public <a> = <b>; import <x.b>;", "expected '<rule> = …', found 'import <x.b>'"),
        (HEADER + "public <a> = <h.b>; <b> = yes;", "it has no rule <h.b>, only <a>, <b>"),
        (HEADER + "public <a> = x; <g.a> = y;", "the rule <a> is defined twice"),
        ("#JSGF V1.0;\npublic <a> = yes;", "line 1: expected 'grammar <name>;' behind '#JSGF V1.0;'"),
        ("#JSGF V1.0;", "line 1: expected 'grammar <name>;' behind '#JSGF V1.0;'"),
        (HEADER + "grammar h; public <a> = yes;", "expected '<rule> = …', found 'grammar h'"),
        (HEADER + "public <a.b> = yes;", "the public rule <a.b> is one of another grammar"),
    ],
)
def test_what_is_wrong_is_named(grammar: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        check_grammar(grammar)


def test_the_words_are_reported() -> None:
    assert check_grammar(HEADER + 'public <a> = "ice cream" [please] | <b>; <b> = no;') == [
        *('"ice cream"', "please", "no"),
    ]


@pytest.fixture(scope="module")
def recognizer() -> SpeechRecognizer:
    return SpeechRecognizer()


@pytest.mark.skipif(not available(), reason="pip has no pocketsphinx for this Python and processor")
@pytest.mark.parametrize(
    ("grammar", "fits"),
    [
        (HEADER + "public <a> = yes | [no] <NULL>;", True),
        (HEADER + "public<a>=yes;<b>=no;", True),
        (HEADER + "public <a> = <g.b> | <b>; <b> = yes;", True),
        (HEADER + "public <g.a> = <b>; <g.b> = yes;", True),
        (HEADER + "import <x.y>; public <a> = <y>;", True),
        (HEADER + "public <a> = yes/* or */no;", True),
        ("#JSGF V1.0;\ngrammar my-orders;\npublic <a> = <my-orders.b>; <b> = yes;", True),
        ("#JSGF V1.0; grammar a.b.c; public <a> = <a.b.c.b>; <b> = yes;", True),
        ("#JSGF V1.0; public <a> = yes;", False),
        ("#JSGF V1.0; public <a> = yes; grammar g;", False),
        ("#JSGF V1.0; import <x.y>; grammar g; public <a> = yes;", False),
        (HEADER + "grammar h; public <a> = yes;", False),
        (HEADER + "public <a> = yes; import <x.y>;", False),
        (HEADER + "public <a.b> = yes;", False),
        (HEADER + 'public <a> = "yes" | no;', False),
        (HEADER + 'public <a> = "ice cream" | no;', False),
    ],
)
def test_the_check_takes_what_the_recogniser_of_merlin_takes(
    recognizer: SpeechRecognizer, grammar: str, fits: bool
) -> None:
    with contextlib.nullcontext() if fits else pytest.raises(GrammarError):
        recognizer.use(grammar)
    with contextlib.nullcontext() if fits else pytest.raises(ValueError):
        if unknown_words(check_grammar(grammar)):
            raise ValueError("a word is unknown")


PARTS = ["yes", "no", "/1.5/", "{a tag}", "*", "+", "(", ")", "[", "]", "|", "<NULL>", "<b>", "/* or */"]


@pytest.mark.skipif(not available(), reason="pip has no pocketsphinx for this Python and processor")
@given(body=st.lists(st.sampled_from(PARTS), min_size=1, max_size=7).map(" ".join))
def test_of_any_rule_the_check_says_what_the_recogniser_says(recognizer: SpeechRecognizer, body: str) -> None:
    grammar = f"{HEADER}<b> = no; public <a> = {body};"
    try:
        recognizer.use(grammar)
    except GrammarError:
        with pytest.raises(ValueError, match="the grammar cannot be used, line 1: "):
            check_grammar(grammar)
    else:
        check_grammar(grammar)
