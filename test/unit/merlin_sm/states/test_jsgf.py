# SPDX-License-Identifier: Apache-2.0
"""Grammars that cannot be used are named when their state is made; those that can are left alone."""

import pytest

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
        (HEADER + "public <a = yes;", "expected '<rule> = …'"),
    ],
)
def test_what_is_wrong_is_named(grammar: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        check_grammar(grammar)


def test_the_words_are_reported() -> None:
    assert check_grammar(HEADER + 'public <a> = "ice cream" [please] | <b>; <b> = no;') == [
        *("ice", "cream", "please", "no"),
    ]
