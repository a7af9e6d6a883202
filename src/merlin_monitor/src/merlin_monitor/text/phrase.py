# SPDX-License-Identifier: Apache-2.0
"""Sentences as data: a text with blanks and what fills them, so that each reader gets them in his language.

The English text is the key of the page's tables (``web/texts.<language>.json``). A phrase is a text that is
shown as it is (a name, what a node said), a list of phrases, a form that the functions below make, or the
same text in several languages: ``{"english": …, "de": …}``.
"""

import re
from typing import Any, Container, Dict, List, Mapping, Sequence, Union

_PREPOSITIONS = ("from", "to", "at", "in", "on", "with", "by", "for", "into", "onto", "through", "near")
_VOWELS = "aeiou"
_CLAIMS = re.compile(r"\b(?:already|is|are|was|were|has been|have been)(?: |$)")


def gerund(verb: str) -> str:
    """``navigate`` → ``navigating``; of several words the first: ``check_table`` → ``checking table``."""
    first, *rest = verb.replace("-", "_").split("_")
    if not first.isascii() or not first.isalpha():
        return verb
    word = first.lower()
    if word.endswith("ie"):
        word = word[:-2] + "ying"
    elif word.endswith("e") and not word.endswith(("ee", "oe", "ye")) and len(word) > 2:
        word = word[:-1] + "ing"
    elif (
        len(word) in (3, 4)
        and word[-1] not in _VOWELS + "wxy"
        and word[-2] in _VOWELS
        and sum(letter in _VOWELS for letter in word) == 1
    ):
        word += word[-1] + "ing"
    else:
        word += "ing"
    return " ".join([word, *rest])


def action_in_words(
    name: str, parameters: Sequence[Sequence[str]], places: Container[str] = (), names: Mapping[str, str] = {}
) -> str:
    """What a robot does that runs an action.

    :param parameters: variable and object; variables that are prepositions are used as such.
    :param places: objects that are places: one is *at* them. A name that ends with a number takes no article.
    :param names: of objects, where they have one of their own.
    """
    words = [gerund(name)]
    for variable, value in parameters:
        place, spaced = value in places, value.replace("_", " ")
        if variable.lower() == "from" and not place:
            continue  # a robot that was stopped on its way starts "anywhere"
        article = "the " if place and not spaced[-1:].isdigit() else ""
        shown = names.get(value.lower(), article + spaced)
        preposition = variable.lower() if variable.lower() in _PREPOSITIONS else "at" if place else ""
        words.append(f"{preposition} {shown}".strip())
    return " ".join(words)


def fact_in_words(predicate: str, names: Sequence[str], wanted: bool = False) -> str:
    """``kitchen checked``, ``robot at kitchen``, ``ann wants coffee``.

    :param names: of the objects, as they are shown.
    :param wanted: it is a goal: the words that say that it is so already are left out.
    """
    words = predicate.replace("_", " ").replace("-", " ")
    if wanted:
        words = _CLAIMS.sub("", words).strip() or words
    if len(names) == 1 and words.split()[-1:] and words.split()[-1].lower() in _PREPOSITIONS:
        return f"{words} {names[0]}"
    return " ".join([*names[:1], words, *names[1:]])


def function_in_words(function: str, names: Sequence[str]) -> str:
    """``battery of r2``, ``travel time of hall, kitchen``.

    :param names: of the objects, as they are shown.
    """
    words = function.replace("_", " ").replace("-", " ")
    return f"{words} of {', '.join(names)}" if names else words


def listed(texts: Sequence[str], most: int = 3) -> str:
    """``a``, ``a and b``, ``a, b and c``, ``a, b, c and 4 more``."""
    shown = list(texts[:most])
    if len(texts) > most:
        return f"{', '.join(shown)} and {len(texts) - most} more"
    if len(shown) > 1:
        return f"{', '.join(shown[:-1])} and {shown[-1]}"
    return "".join(shown)


Phrase = Union[str, Dict[str, Any], List[Any]]
_BLANK = re.compile(r"\{(\w+)\}")


def say(text: str, /, **blanks: Phrase) -> Phrase:
    """A sentence: ``say("step {number} of {count}", number="2", count="5")``."""
    return {"say": text, **blanks}


def with_reason(what: Phrase, why: Phrase) -> Phrase:
    """A sentence and what a node says about it; without a reason the sentence alone."""
    return say("{what}: {why}", what=what, why=why) if why else what


def in_english(phrase: Phrase) -> str:
    """The English text of a phrase."""
    if isinstance(phrase, str):
        return phrase
    if isinstance(phrase, list):
        return listed([in_english(part) for part in phrase])
    if "english" in phrase:
        return str(phrase["english"])
    return _BLANK.sub(lambda blank: in_english(phrase.get(blank.group(1), blank.group(0))), phrase["say"])
