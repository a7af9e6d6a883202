# SPDX-License-Identifier: Apache-2.0
"""The file of the sentences: what is wrong with it, and that those of the examples fit all their domains."""

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Dict, List

import pytest
import rospy

from merlin_monitor.panels.control import sentences_of_node
from merlin_monitor.text.sentences import Sentences, SentencesError, domain_faults, read_sentences
from merlin_pddl.domain_reader import read_domain
from merlin_ros.parameters import ParameterError

PDDL = Path(__file__).resolve().parents[4] / "pddl"
DOMAIN = {
    "operators": {"greet": [("c", "client")]},
    "predicates": {"seated": [("c", "client")]},
    "functions": {},
}


def write(folder: Path, text: str) -> Path:
    path = folder / "sentences.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def faults(folder: Path, text: str) -> List[str]:
    with pytest.raises(SentencesError) as raised:
        read_sentences(write(folder, text))
    where = f"the list of sentences {folder / 'sentences.yaml'}"
    assert all(fault.startswith(where) for fault in raised.value.faults)
    return [fault[len(where) :].lstrip(", :") for fault in raised.value.faults]


SHAPES = [
    ("a: [", "is not YAML: while parsing"),
    ("- greet", "is ['greet'], where operators: {…} belongs"),
    (
        "operator: {}",
        "there is no 'operator', only operators, predicates, functions, objects, optional (did you",
    ),
    ("optional: r", "optional: is 'r', not a list of names"),
    ("operators: [greet]", "operators: is ['greet'], where name: {en: …} belongs"),
    ("operators: {greet: greets}", 'operators.greet: is \'greets\', where {en: "…", de: "…"} belongs'),
    ("operators: {no: {en: a}}", "operators: has the key False, which is not a text; write it in quotes"),
    ("operators: {greet: {en: 5}}", "operators.greet.en: is 5, not a text; write it in quotes"),
    ("operators: {greet: {en: ' '}}", "operators.greet.en: is ' ', not a text"),
    ("operators: {greet: {en: a, fr: b}}", "operators.greet.fr: is no language of the page: en, de"),
    ("operators: {greet: {de: a}}", "operators.greet: has no 'en'; add en: …"),
    ("operators: {greet: {en: '{c'}}", "operators.greet.en: '{c' has a bracket too much or too few"),
    ("operators: {greet: {en: '[a [{c}]]'}}", "operators.greet.en: '[a [{c}]]' has a bracket too much"),
    ("predicates: {seated: {en: a, goal: sit}}", "predicates.seated.goal: is 'sit', where"),
]


@pytest.mark.parametrize(("text", "said"), SHAPES)
def test_a_wrong_shape_is_reported_once_with_its_key(tmp_path: Path, text: str, said: str) -> None:
    (fault,) = faults(tmp_path, text)
    assert fault.startswith(said)


def test_each_name_needs_all_languages_of_the_file(tmp_path: Path) -> None:
    text = "operators: {a: {en: a}, b: {en: b, de: b}}\npredicates: {c: {en: c, de: c, goal: {en: c}}}"
    assert faults(tmp_path, text) == [
        "operators.a: has no 'de'; add de: …",
        "predicates.c.goal: has no 'de'; add de: …",
    ]
    assert read_sentences(write(tmp_path, "operators: {a: {en: a}}")).languages == ["en"]


def test_a_file_that_is_missing_is_reported(tmp_path: Path) -> None:
    with pytest.raises(SentencesError, match="cannot be read: .*No such file"):
        read_sentences(tmp_path / "none.yaml")


@pytest.mark.parametrize("text", ["", "# only a comment", "operators:\n  # greet: {en: a}\n"])
def test_a_file_of_comments_has_no_sentences(tmp_path: Path, text: str) -> None:
    read = read_sentences(write(tmp_path, text))
    assert (read.operators, read.objects, read.languages) == ({}, {}, ["en"])


FAULTS = [
    (
        "operators: {gret: {en: a}}",
        "operators.gret: the domain has no operator 'gret' (did you mean 'greet'?)",
    ),
    ("predicates: {away: {en: a, goal: {en: b}}}", "predicates.away: the domain has no predicate 'away'"),
    ("functions: {pace: {en: a}}", "functions.pace: the domain has no function 'pace'"),
    (
        "operators: {greet: {en: '{d} {d}'}}",
        "operators.greet.en: operator greet has no parameter 'd', only c",
    ),
    ("operators: {greet: {en: '[{d}]'}}", "operators.greet.en: operator greet has no parameter 'd', only c"),
    (
        "optional: [r]\noperators: {greet: {en: '{r} {c}'}}",
        "operators.greet.en: operator greet has no parameter 'r', only c; write what needs it in [brackets]",
    ),
    (
        "predicates: {seated: {en: a, goal: {en: '{x}'}}}",
        "predicates.seated.goal.en: predicate seated has no parameter 'x', only c",
    ),
]


@pytest.mark.parametrize(("text", "said"), FAULTS)
def test_what_the_domain_does_not_have_is_reported_once(tmp_path: Path, text: str, said: str) -> None:
    (fault,) = domain_faults(read_sentences(write(tmp_path, text)), DOMAIN)
    assert fault == f"the list of sentences {tmp_path / 'sentences.yaml'}, {said}"


def test_what_only_other_domains_have_is_optional(tmp_path: Path) -> None:
    text = "optional: [r, fly]\noperators: {greet: {en: '[{r} ]greets {c}'}, fly: {en: '{r} flies'}}"
    assert domain_faults(read_sentences(write(tmp_path, text)), DOMAIN) == []


def signatures(path: Path) -> Dict[str, Any]:
    domain = read_domain(path)
    groups = {"operators": domain.operators, "predicates": domain.predicates, "functions": domain.functions}
    return {
        group: {name: [(each.label, "") for each in one.parameters] for name, one in named.items()}
        for group, named in groups.items()
    }


@pytest.mark.parametrize("example", ["home", "restaurant"])
def test_the_sentences_of_an_example_fit_its_domains_and_leave_nothing_out(example: str) -> None:
    read: Sentences = read_sentences(PDDL / example / "sentences.yaml")
    assert read.languages == ["en", "de"]
    for file in ("domain.pddl", "robots.pddl"):
        domain = signatures(PDDL / example / file)
        assert domain_faults(read, domain) == []
        for group, named in domain.items():
            assert set(named) <= set(getattr(read, group)), f"{group} of {file}"


def test_a_monitor_does_not_begin_with_a_wrong_file_and_a_terminal_begins_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    warned: List[str] = []
    monkeypatch.setattr(rospy, "logwarn", warned.append)
    path = write(tmp_path, "operators: {greet: {en: 5}}")
    ros: Any = SimpleNamespace(
        parameter=lambda name, default: {"merlin/sentences": str(path)}.get(name, default)
    )
    with pytest.raises(ParameterError, match="operators.greet.en: is 5, not a text"):
        sentences_of_node(ros)
    assert sentences_of_node(ros, needed=False) == Sentences()
    (warning,) = warned
    assert warning.endswith("is 5, not a text; write it in quotes; words are made of the names in PDDL")
    ros.parameter = lambda name, default: "none"
    assert sentences_of_node(ros) == Sentences()


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.yaml"
    os.mkfifo(pipe)
    for path in (Path(os.devnull), pipe):
        with pytest.raises(SentencesError, match="cannot be read: only a regular file can be"):
            read_sentences(path)


def test_a_file_that_cannot_be_looked_for_is_refused() -> None:
    with pytest.raises(SentencesError, match="cannot be read: .*File name too long"):
        read_sentences(Path("x" * 300))  # as one in the folder of another user
