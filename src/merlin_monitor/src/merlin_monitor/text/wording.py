# SPDX-License-Identifier: Apache-2.0
"""What actions, facts and goals are called: as the application's sentences say, else by their names."""

import re
from typing import Any, Callable, Container, Dict, List, Mapping, Optional, Sequence

from merlin_monitor.text.phrase import (
    Phrase,
    action_in_words,
    fact_in_words,
    function_in_words,
    in_english,
    say,
    with_reason,
)
from merlin_monitor.text.sentences import (
    LANGUAGES,
    Forms,
    Sentences,
    domain_faults,
    fill,
    filled_parts,
    has_blank,
)
from merlin_ros.robot_values import is_robot

NO_SENTENCES = Sentences()
_TOKEN = re.compile(r"[()]|[^\s()]+")
_NAMES = re.compile(r"[\w\s()<>=?:.+*/@#-]*\Z")  # what else there is, is not PDDL
_COMPARISONS = {">=": "≥", "<=": "≤", ">": ">", "<": "<", "=": "="}
_DEEPEST = 20  # parentheses within each other that are put into words
_ATOM = re.compile(r"\(([^\s()]+(?: [^\s()]+)*)\)")


class Wording:
    """Makes the words; each phrase has them in all languages of the sentences.

    :param sentences: of the application.
    """

    def __init__(self, sentences: Sentences = NO_SENTENCES) -> None:
        self.sentences = sentences
        self.places: Container[str] = ()
        """Objects that are places."""
        self._labels: Dict[str, List[str]] = {}  # of predicates and functions
        self._operators: Dict[str, List[str]] = {}
        self._robots: Dict[str, str] = {}  # operator → label of the robot that runs it

    def learn(self, domain: Mapping[str, Any]) -> List[str]:
        """Takes the domain, as the section of the knowledge has it; returns what the sentences do not fit."""
        types = domain.get("types", {})
        atoms = {**domain.get("functions", {}), **domain.get("predicates", {})}
        self._labels = {name: [label.lower() for label, _ in pairs] for name, pairs in atoms.items()}
        self._operators = {name: [label for label, _ in pairs] for name, pairs in domain["operators"].items()}
        for name, pairs in domain["operators"].items():
            robots = [label for label, kind in pairs if is_robot(kind, types)]
            self.run_by({name: robots[0]} if robots else {})
        return domain_faults(self.sentences, {"functions": {}, "predicates": {}, **domain})

    def run_by(self, robots: Mapping[str, str]) -> None:
        """Takes which parameter of an operator is the robot that runs it, by the operator's name."""
        self._robots.update(robots)

    def shown(self) -> Dict[str, Any]:
        """What the page makes the words of a long list with: templates by positions, and names of objects."""
        facts: Dict[str, Any] = {}
        for name, labels in self._labels.items():
            if self._forms_of(name):
                facts[name] = _by_place(self._forms_of(name), labels)
            if name in self.sentences.goals:
                facts[name]["goal"] = _by_place(self.sentences.goals[name], labels)
        objects = {name: _by_language(forms) for name, forms in self.sentences.objects.items()}
        return {"facts": facts, "objects": objects}

    def name(self, thing: str, language: str = "en") -> str:
        """What an object is called."""
        return self.sentences.objects.get(thing.lower(), {}).get(language, thing.replace("_", " "))

    def action(self, name: str, parameters: Sequence[Sequence[str]], subject: bool = True) -> Phrase:
        """What a robot does that runs an action.

        :param parameters: variable and object.
        :param subject: whether one of several robots is named.
        """
        robot = self._robots.get(name, "")
        values = {label.lower(): value for label, value in parameters if subject or label != robot}
        who = values.get(robot.lower(), "")
        forms = self.sentences.operators.get(name.lower())
        if forms:
            named = [text for text in forms.values() if has_blank(text, robot.lower())]
            if not subject and any(has_blank(filled_parts(text, values), robot.lower()) for text in named):
                return self.action(name, parameters)
            filled = self._filled(forms, values)
            if who and not named:
                for language in forms:
                    filled[_KEYS[language]] = f"{self.name(who, language)} {filled[_KEYS[language]]}"
            return filled
        rest = [(label, value) for label, value in parameters if label != robot]
        names = {thing: known["en"] for thing, known in self.sentences.objects.items()}
        # Other languages have no gerund: the page shows the names.
        bare = " ".join([name, *(value for _, value in rest)]).replace("_", " ").replace("-", " ")
        words = {"action": bare, "english": action_in_words(name, rest, self.places, names)}
        return with_reason(self._object(who), words) if who else words

    def fact(self, text: str) -> Phrase:
        """A fact, or an `and` of several, in words; what cannot be read stays."""
        return self._formula(text, False)

    def goal(self, text: str) -> Phrase:
        """A goal in words, which do not say that it holds; what cannot be read stays."""
        return self._formula(text, True)

    def value(self, function: str) -> Phrase:
        """What a number is the value of: ``(travel_time hall kitchen)``."""
        name, *objects = function.strip("()").split() or [""]
        return self._atom(name, objects, function_in_words)

    def reason(self, text: str, of: str = "", without: str = "") -> Phrase:
        """A reason of a node, with words instead of the PDDL in it.

        :param of: the action, as PDDL text, beside which it is shown and which it need not name again.
        :param without: the planner's own words, which are left out at its end.
        """
        if without and text.endswith(without):
            text = text[: -len(without)].rstrip(" :;")
        if of and text.startswith(f"{of} "):
            text = re.sub(r"^failed: ", "", text[len(of) + 1 :])
        found = {atom[0]: self._said(atom[1].split()) for atom in _ATOM.finditer(text)}
        found = {atom: words for atom, words in found.items() if words}
        if not found:
            return text
        return {
            key: _with_words(text, found, key) for key in (_KEYS[each] for each in self.sentences.languages)
        }

    # --- how ------------------------------------------------------------------------------------------------

    def _forms_of(self, name: str) -> Forms:
        return self.sentences.predicates.get(name.lower()) or self.sentences.functions.get(name.lower()) or {}

    def _filled(self, forms: Forms, objects: Mapping[str, str]) -> Dict[str, Any]:
        """The templates of all languages, filled with the names of objects."""
        filled = {}
        for language, text in forms.items():
            names = {label: self.name(thing, language) for label, thing in objects.items()}
            filled[_KEYS[language]] = fill(filled_parts(text, names), names)
        return filled

    def _object(self, thing: str) -> Phrase:
        forms = self.sentences.objects.get(thing.lower())
        return _by_language(forms) if forms else self.name(thing)

    def _said(self, atom: List[str]) -> Phrase:
        """An action or a fact of the domain in words; empty: the domain has no such thing."""
        name, *objects = atom
        labels = self._operators.get(name)
        if labels is not None and len(labels) == len(objects):
            return self.action(name, list(zip(labels, objects)))
        return self._atom(name, objects, fact_in_words) if name in self._labels else ""

    def _formula(self, text: str, wanted: bool) -> Phrase:
        if not _NAMES.match(text):
            return text
        stack: List[List[Any]] = [[]]
        for token in _TOKEN.findall(text):
            if token == "(":
                stack.append([])
            elif token != ")":
                stack[-1].append(token)
            elif len(stack) > 1:
                read = stack.pop()
                stack[-1].append(read)
            if len(stack) > _DEEPEST:
                return text
        if len(stack) != 1 or not stack[0]:
            return text
        phrases = [self._part(part, wanted) for part in stack[0]]
        return phrases[0] if len(phrases) == 1 else phrases

    def _part(self, part: Any, wanted: bool) -> Phrase:
        if isinstance(part, str):
            return self._object(part)
        if not part:
            return ""
        head, *rest = part
        if not isinstance(head, str):
            return " ".join(in_english(self._part(each, False)) for each in part)
        if head == "and":
            return [self._part(each, wanted) for each in rest]
        if head == "not" and len(rest) == 1:
            return say("not {what}", what=self._part(rest[0], False))
        if head in _COMPARISONS and len(rest) == 2:
            left, right = (self._part(each, False) for each in rest)
            return say(f"{{left}} {_COMPARISONS[head]} {{right}}", left=left, right=right)
        if not all(isinstance(each, str) for each in part):
            return " ".join(in_english(self._part(each, False)) for each in part)
        goal = self.sentences.goals.get(head.lower()) if wanted else None
        return self._atom(head, rest, lambda name, names: fact_in_words(name, names, wanted), goal)

    def _atom(
        self,
        name: str,
        objects: List[str],
        words: Callable[[str, Sequence[str]], str],
        forms: Optional[Forms] = None,
    ) -> Phrase:
        """A predicate or function with its objects: by its template, else by `words`."""
        labels, forms = self._labels.get(name.lower(), []), forms or self._forms_of(name)
        if forms and len(labels) == len(objects):
            return self._filled(forms, dict(zip(labels, objects)))
        return {"english": words(name, [self.name(each) for each in objects])}


#: Language → its key in a phrase.
_KEYS = {language: "english" if language == "en" else language for language in LANGUAGES}


def _by_language(forms: Forms) -> Dict[str, Any]:
    return {_KEYS[language]: text for language, text in forms.items()}


def _by_place(forms: Forms, labels: Sequence[str]) -> Dict[str, Any]:
    """Templates with the places of the parameters, from 0, for their names."""
    values = {label: f"{{{place}}}" for place, label in enumerate(labels)}
    return _by_language({each: fill(filled_parts(text, labels), values) for each, text in forms.items()})


def _with_words(text: str, found: Mapping[str, Any], key: str) -> str:
    """A text with words, in quotes, in the place of its atoms.

    :param key: of the language.
    """

    def put(atom: "re.Match[str]") -> str:
        words = found.get(atom[0])
        if not words:
            return atom[0]
        return f"“{words[key] if isinstance(words, dict) and key in words else in_english(words)}”"

    return _ATOM.sub(put, text)
