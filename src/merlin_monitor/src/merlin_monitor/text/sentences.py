# SPDX-License-Identifier: Apache-2.0
"""The sentences of an application, `sentences.yaml`: what its operators and predicates are called."""

import os
import re
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

import yaml

from merlin_pddl.text_reader import suggestion


class YamlFileError(ValueError):
    """The file cannot be used; the text names it and says why."""


def read_yaml(path: Path, what: str, text: Optional[str] = None) -> Any:
    """What a file has.

    :param what: it is, for the error.
    :param text: that it had; None: it is read now.
    :raises YamlFileError: when it cannot be read, or is not YAML.
    """
    if text is None and os.path.exists(path) and not os.path.isfile(path):  # a pipe may have no end
        raise YamlFileError(f"{what} {path} cannot be read: only a regular file can be")
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8") if text is None else text)
    except (OSError, UnicodeDecodeError) as error:
        raise YamlFileError(f"{what} {path} cannot be read: {error}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # 2020-13-45 is a date for YAML
        raise YamlFileError(f"{what} {path} is not YAML: {' '.join(str(error).split())}") from error


LANGUAGES = ("en", "de")  # of the page, TABLES of web/texts.js
#: Groups of the file → what the domain calls one of them.
GROUPS = {"operators": "operator", "predicates": "predicate", "functions": "function", "objects": "object"}
FILE = "the list of sentences"
OPTIONAL, GOAL = "optional", "goal"
_BLANK = re.compile(r"\{([^\s{}\[\]]+)\}")
_PART = re.compile(r"\[([^\[\]]*)\]")

Forms = Mapping[str, str]  # language → template
#: Name → its parameters, pairs of label and type.
Signatures = Mapping[str, Sequence[Sequence[str]]]


class SentencesError(ValueError):
    """The sentences cannot be used; the text has the first fault.

    :ivar faults: all of them, with file, key, and what to do.
    """

    def __init__(self, faults: List[str]) -> None:
        more = f" (and {len(faults) - 1} more; rosrun merlin check names them)" if len(faults) > 1 else ""
        super().__init__(faults[0] + more)
        self.faults = faults


class Sentences(NamedTuple):
    """Templates by name and language; names and blanks in small letters.

    :ivar file: for what is said about them.
    :ivar languages: of all of them.
    :ivar goals: of predicates, where they are wanted.
    :ivar optional: names and parameters that only some of the domains of the application have.
    """

    file: str = ""
    languages: Sequence[str] = ("en",)
    operators: Mapping[str, Forms] = {}
    predicates: Mapping[str, Forms] = {}
    functions: Mapping[str, Forms] = {}
    objects: Mapping[str, Forms] = {}
    goals: Mapping[str, Forms] = {}
    optional: Sequence[str] = ()


def read_sentences(path: Path, text: Optional[str] = None) -> Sentences:
    """The sentences of a file; none where it has comments only.

    :param text: that it had when something was recorded; None: it is read now.
    :raises SentencesError: when it cannot be used.
    """
    try:
        found = read_yaml(path, FILE, text)
    except YamlFileError as error:
        raise SentencesError([str(error)]) from error
    reader = _Reader(f"{FILE} {path}")
    sentences = reader.read({} if found is None else found)
    if reader.faults:
        raise SentencesError(reader.faults)
    return sentences


def domain_faults(sentences: Sentences, domain: Mapping[str, Signatures]) -> List[str]:
    """What the sentences name and the domain does not have.

    :param domain: signatures below ``operators``, ``predicates`` and ``functions``.
    """
    faults = []
    for group, kind in list(GROUPS.items())[:-1]:
        known = domain[group]
        goals = {f"{name}.{GOAL}": forms for name, forms in sentences.goals.items()}
        found: Mapping[str, Forms] = getattr(sentences, group)
        for key, forms in {**found, **(goals if group == "predicates" else {})}.items():
            name = key.partition(".")[0]
            if name not in known:
                if name not in sentences.optional and key == name:
                    hint = suggestion(name, known)
                    faults.append(f"{sentences.file}, {group}.{key}: the domain has no {kind} '{name}'{hint}")
                continue
            labels = [label.lower() for label, _ in known[name]]
            for language, text in forms.items():
                for blank in dict.fromkeys(_BLANK.findall(text)):
                    optional = blank in sentences.optional
                    if blank in labels or (optional and not has_blank(_PART.sub("", text), blank)):
                        continue
                    faults.append(
                        f"{sentences.file}, {group}.{key}.{language}: {kind} {name} has no parameter "
                        f"'{blank}', only {', '.join(labels) or 'none'}"
                        f"{'; write what needs it in [brackets]' if optional else ''}"
                    )
    return faults


def filled_parts(template: str, labels: Iterable[str]) -> str:
    """A template without the [parts] in which a blank is for none of these parameters."""
    known = set(labels)
    text = _PART.sub(lambda part: part[1] if known.issuperset(_BLANK.findall(part[1])) else "", template)
    return " ".join(text.split())


def fill(template: str, values: Mapping[str, str]) -> str:
    """A template with its blanks filled; those that have no value stay."""
    return _BLANK.sub(lambda blank: values.get(blank[1], blank[0]), template)


def has_blank(template: str, label: str) -> bool:
    """Whether a template has a blank for a parameter."""
    return label in _BLANK.findall(template)


class _Reader:
    """Takes the file apart, and notes what is wrong with its shape."""

    def __init__(self, file: str) -> None:
        self._file = file
        self._seen: List[Tuple[str, Mapping[str, Any]]] = []
        self.faults: List[str] = []

    def read(self, found: Any) -> Sentences:
        """What is right in the file."""
        named: Dict[str, Mapping[str, Any]] = {group: {} for group in GROUPS}
        optional: List[str] = []
        known = (*GROUPS, OPTIONAL)
        for key, value in self._mapping("", found, "operators: {…}").items():
            if key not in known:
                self._wrong("", f"there is no '{key}', only {', '.join(known)}{suggestion(key, known)}")
            elif key != OPTIONAL:
                # All of its lines may be comments.
                named[key] = {} if value is None else self._mapping(key, value, "name: {en: …}")
            elif isinstance(value, list) and all(isinstance(each, str) for each in value):
                optional = [each.lower() for each in value]
            else:
                self._wrong(key, f"is {_shown(value)}, not a list of names; write [r, take_over]")
        tables: Dict[str, Dict[str, Forms]] = {group: {} for group in (*GROUPS, "goals")}
        for group, each in named.items():
            for name, forms in each.items():
                if group == "predicates" and isinstance(forms, dict) and GOAL in forms:
                    goal = self._forms(f"{group}.{name}.{GOAL}", forms[GOAL])
                    tables["goals"][name.lower()] = goal
                    forms = {language: text for language, text in forms.items() if language != GOAL}
                tables[group][name.lower()] = self._forms(f"{group}.{name}", forms)
        return Sentences(self._file, self._languages(), optional=optional, **tables)

    def _forms(self, where: str, found: Any) -> Forms:
        """The templates of a name, by their languages."""
        forms = self._mapping(where, found, '{en: "…", de: "…"}')
        right = {}
        for language, text in forms.items():
            if language not in LANGUAGES:
                self._wrong(f"{where}.{language}", f"is no language of the page: {', '.join(LANGUAGES)}")
            elif not isinstance(text, str) or not text.strip():
                self._wrong(f"{where}.{language}", f"is {_shown(text)}, not a text; write it in quotes")
            elif re.search(r"[][{}]", _BLANK.sub("", _PART.sub(r"\1", text))):
                self._wrong(
                    f"{where}.{language}",
                    f"{_shown(text)} has a bracket too much or too few; write {{parameter}}, [part]",
                )
            else:
                right[language] = _BLANK.sub(lambda blank: blank[0].lower(), text)
        if isinstance(found, dict):
            self._seen.append((where, forms))
        return right

    def _languages(self) -> List[str]:
        """The languages that the file uses: each name needs all of them."""
        used: Set[str] = {"en"}.union(*(forms for _, forms in self._seen))
        for where, forms in self._seen:
            for language in sorted(used.intersection(LANGUAGES).difference(forms)):
                self._wrong(where, f"has no '{language}'; add {language}: …")
        return [language for language in LANGUAGES if language in used]

    def _mapping(self, where: str, found: Any, example: str) -> Mapping[str, Any]:
        if not isinstance(found, dict):
            self._wrong(where, f"is {_shown(found)}, where {example} belongs")
            return {}
        for key in found:
            if not isinstance(key, str):  # no and on are truth values for YAML
                self._wrong(where, f"has the key {key!r}, which is not a text; write it in quotes")
        return {key: value for key, value in found.items() if isinstance(key, str)}

    def _wrong(self, where: str, what: str) -> None:
        self.faults.append(f"{self._file}{f', {where}' if where else ''}: {what}")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
