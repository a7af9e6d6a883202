"""Actions and goals in plain words."""

from typing import Container, Sequence, Tuple

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


def action_in_words(name: str, parameters: Sequence[Tuple[str, str]], places: Container[str] = ()) -> str:
    """What a robot does that runs an action.

    :param parameters: variable and object; variables that are prepositions are used as such.
    :param places: objects that are places: one is *at* them.
    """
    words = [gerund(name)]
    for variable, value in parameters:
        shown = value.replace("_", " ")
        if value in places:
            shown = f"the {shown}"
        preposition = variable.lower() if variable.lower() in _PREPOSITIONS else ""
        if not preposition and value in places:
            preposition = "at"
        words.append(f"{preposition} {shown}".strip())
    return " ".join(words)


def listed(texts: Sequence[str], most: int = 3) -> str:
    """``a``, ``a and b``, ``a, b and c``, ``a, b, c and 4 more``."""
    shown = list(texts[:most])
    if len(texts) > most:
        return f"{', '.join(shown)} and {len(texts) - most} more"
    if len(shown) > 1:
        return f"{', '.join(shown[:-1])} and {shown[-1]}"
    return "".join(shown)
