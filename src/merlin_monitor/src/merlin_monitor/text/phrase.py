# SPDX-License-Identifier: Apache-2.0
"""Sentences as data: a text with blanks and what fills them, so that each reader gets them in his language.

The English text is the key of the page's tables (``web/texts.<language>.json``). A phrase is a text that is
shown as it is (a name, what a node said), a list of phrases, or a form that the functions below make.
"""

import re
from typing import Any, Container, Dict, List, Sequence, Tuple, Union

_PREPOSITIONS = ("from", "to", "at", "in", "on", "with", "by", "for", "into", "onto", "through", "near")
_VOWELS = "aeiou"


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


def shown_parameters(
    parameters: Sequence[Tuple[str, str]], places: Container[str] = ()
) -> List[Tuple[str, str]]:
    """Variables and objects as a sentence shows them: no underscores, and no start that is not a place.

    :param places: objects that are places; a name that ends with a number takes no article.
    """
    shown = []
    for variable, value in parameters:
        if variable.lower() == "from" and value not in places:
            continue  # a robot that was stopped on its way starts "anywhere"
        name = value.replace("_", " ")
        numbered = name[-1:].isdigit()
        shown.append((variable, f"the {name}" if value in places and not numbered else name))
    return shown


def action_in_words(name: str, parameters: Sequence[Tuple[str, str]], places: Container[str] = ()) -> str:
    """What a robot does that runs an action.

    :param parameters: variable and object; variables that are prepositions are used as such.
    :param places: objects that are places: one is *at* them.
    """
    objects = {name.replace("_", " ") for _, name in parameters if name in places}
    words = [gerund(name)]
    for variable, shown in shown_parameters(parameters, places):
        preposition = variable.lower() if variable.lower() in _PREPOSITIONS else ""
        if not preposition and (shown in objects or shown[4:] in objects):
            preposition = "at"
        words.append(f"{preposition} {shown}".strip())
    return " ".join(words)


def fact_in_words(predicate: str, names: Sequence[str]) -> str:
    """``kitchen checked``, ``robot at kitchen``, ``ann wants coffee``.

    :param names: of the objects, as they are shown.
    """
    words = predicate.replace("_", " ").replace("-", " ")
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
_TOKEN = re.compile(r"[()]|[^\s()]+")
_NAMES = re.compile(r"[\w\s()<>=?:.+*/@#-]*\Z")  # what else there is, is not PDDL
_COMPARISONS = {">=": "≥", "<=": "≤", ">": ">", "<": "<", "=": "="}
_DEEPEST = 20  # parentheses within each other that are put into words


def say(text: str, /, **blanks: Phrase) -> Phrase:
    """A sentence: ``say("step {number} of {count}", number="2", count="5")``."""
    return {"say": text, **blanks}


def with_reason(what: Phrase, why: Phrase) -> Phrase:
    """A sentence and what a node says about it; without a reason the sentence alone."""
    return say("{what}: {why}", what=what, why=why) if why else what


def action_phrase(name: str, parameters: Sequence[Tuple[str, str]], places: Container[str] = ()) -> Phrase:
    """What a robot does that runs an action; a table may have words for it under ``action <name>``.

    :param parameters: variable and object.
    :param places: objects that are places.
    """
    english = action_in_words(name, parameters, places)
    return {"action": name, "english": english, "with": dict(shown_parameters(parameters))}


def goal_phrase(goal: str) -> Phrase:
    """A goal in words; what cannot be read stays. A table may have words under ``fact <predicate>``."""
    if not _NAMES.match(goal):
        return goal
    stack: List[List[Any]] = [[]]
    for token in _TOKEN.findall(goal):
        if token == "(":
            stack.append([])
        elif token != ")":
            stack[-1].append(token)
        elif len(stack) > 1:
            read = stack.pop()
            stack[-1].append(read)
        if len(stack) > _DEEPEST:
            return goal
    if len(stack) != 1 or not stack[0]:
        return goal
    phrases = [_formula(part) for part in stack[0]]
    return phrases[0] if len(phrases) == 1 else phrases


def value_phrase(function: str) -> Phrase:
    """What a number is the value of: ``(travel_time hall kitchen)``."""
    name, *objects = function.strip("()").split() or [""]
    names = [each.replace("_", " ") for each in objects]
    return {"fact": name, "english": function_in_words(name, names), "of": names}


def in_english(phrase: Phrase) -> str:
    """The English text of a phrase."""
    if isinstance(phrase, str):
        return phrase
    if isinstance(phrase, list):
        return listed([in_english(part) for part in phrase])
    if "english" in phrase:
        return str(phrase["english"])
    return _BLANK.sub(lambda blank: in_english(phrase.get(blank.group(1), blank.group(0))), phrase["say"])


def _formula(part: Any) -> Phrase:
    if isinstance(part, str):
        return part.replace("_", " ")
    if not part:
        return ""
    head, *rest = part
    if head == "and":
        return [_formula(each) for each in rest]
    if head == "not" and len(rest) == 1:
        return say("not {what}", what=_formula(rest[0]))
    if head in _COMPARISONS and len(rest) == 2:
        left, right = (_formula(each) for each in rest)
        return say(f"{{left}} {_COMPARISONS[head]} {{right}}", left=left, right=right)
    if not all(isinstance(each, str) for each in part):
        return " ".join(in_english(_formula(each)) for each in part)
    names = [name.replace("_", " ") for name in rest]
    return {"fact": head, "english": fact_in_words(head, names), "of": names}
