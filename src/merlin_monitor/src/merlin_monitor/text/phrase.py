"""Sentences as data: a text with blanks and what fills them, so that each reader gets them in his language.

The English text is the key of the page's tables (``web/texts.<language>.json``). A phrase is a text that is
shown as it is (a name, what a node said), a list of phrases, or a form that the functions below make.
"""

import re
from typing import Any, Dict, List, Sequence, Tuple, Union

from merlin_monitor.text.plain_words import fact_in_words, function_in_words, listed

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


def action_phrase(name: str, parameters: Sequence[Tuple[str, str]], english: str) -> Phrase:
    """What a robot does that runs an action; a table may have words for it under ``action <name>``.

    :param parameters: variable and object as it is called.
    """
    return {"action": name, "english": english, "with": dict(parameters)}


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
