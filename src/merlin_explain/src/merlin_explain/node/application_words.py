# SPDX-License-Identifier: Apache-2.0
"""The words of an application, its sentences.yaml, for the sentences of answers."""

from typing import Dict, List, Sequence

from merlin_explain.claims import Words
from merlin_monitor.text.phrase import in_english
from merlin_monitor.text.sentences import Sentences
from merlin_monitor.text.wording import Wording
from merlin_pddl.domain import Domain, Signature

_COMPOUND = tuple(f"({name} " for name in ("and", "or", "imply", "forall", "exists"))


class ApplicationWords(Words):
    """Words as the page has them.

    :param domain: with its operators.
    :param sentences: of the application.
    """

    def __init__(self, domain: Domain, sentences: Sentences) -> None:
        self._wording = Wording(sentences)
        self._labels: Dict[str, List[str]] = {
            name: [parameter.label for parameter in operator.parameters]
            for name, operator in domain.operators.items()
        }
        self._wording.learn(
            {
                "types": {name: (*domain.types.parents(name), "")[0] for name in domain.types},
                "predicates": {name: _pairs(found) for name, found in domain.predicates.items()},
                "functions": {name: _pairs(found) for name, found in domain.functions.items()},
                "operators": {name: _pairs(found) for name, found in domain.operators.items()},
            }
        )

    def step(self, text: str) -> str:
        """An action, ``(navigate hall kitchen)``."""
        name, *objects = text.strip("()").split() or [""]
        labels = self._labels.get(name.lower(), [])
        if len(labels) != len(objects):
            return text
        return in_english(self._wording.action(name, list(zip(labels, objects))))

    def fact(self, text: str) -> str:
        """A fact or a condition that holds; one of several parts as PDDL."""
        return text if text.startswith(_COMPOUND) else in_english(self._wording.fact(text))

    def goal(self, text: str) -> str:
        """What is wanted."""
        return in_english(self._wording.goal(text))


def _pairs(signature: Signature) -> Sequence[Sequence[str]]:
    return [(parameter.label, parameter.types[0]) for parameter in signature.parameters]
