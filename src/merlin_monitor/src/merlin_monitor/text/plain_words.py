"""Actions and goals in plain words."""

from typing import Container, List, Sequence, Tuple

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
