# SPDX-License-Identifier: Apache-2.0
"""Our reader against the planner's: what one of the two reads the other reads, but for what is decided."""

import random
import re
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings

from merlin_pddl.checks.kairos_check import check_input
from merlin_pddl.domain_reader import parse_domain, read_domain
from merlin_pddl.problem_reader import parse_problem, read_problem
from merlin_pddl.text_reader import PddlError

sys.path.insert(0, str(Path(__file__).parent))

import pddl_texts

kairos = pytest.importorskip("kairos")

#: What our reader alone refuses, as VAL does, or because nothing of ours could carry it out.
STRICTER = [
    r"expected (the name of|a name|a predicate|a function|a type|the type)[^']*'[^']*[.@][^']*'",
    r"expected (the name of|a name|a predicate|a function|a type)[^']*'[0-9][^']*'",
    r"expected [^']*, found '-[^']*'",
    r"expected a variable such as '\?x', found '\?([0-9]|[^']*[.@])",
    r"expected a (predicate|function), found '-?[0-9][^']*'",
    r"is not a word of PDDL",
    r"there may be no blank between",
    r"'-' needs a (name|type) before it",
    r"this '\)' closes nothing",
    r"unknown (object|predicate|function) '",
    r"takes \d+ argument\(s\), here are \d+",
    r"':(domain|goal|metric)' stands twice",
    r"the problem belongs to the domain",
    r"is declared twice, with other parameters",
    r"stands twice among the parameters",
    r"the derived predicate '[^']*' is not declared",
    r"has a meaning in PDDL and cannot be the name of a function",
    r"expected \(at start \.\.\.\), \(over all \.\.\.\) or \(at end \.\.\.\)",
    r"expected \(= \?duration <number>\)",
    r"is a trajectory constraint",
    r"expected one of :parameters",
    r"expected \((problem|domain|:domain) <name>\)",
    r"the type 'object' is its own ancestor",
    r"nested deeper than",
    r"a preference cannot be negated",  # twice, which kairos reads
    r"a timed fact lies between 0 and",
]
#: What only the planner refuses: the knowledge base works it out, and writes a number.
CALCULATED = "initial value of '"

EMPTY = "(define (problem p) (:domain {}) (:init) (:goal (and)))"


def difference(read, check):
    """What is not decided about one text; None when both readers agree or it is decided."""
    try:
        read()
        ours = None
    except PddlError as error:
        ours = str(error)
        assert error.line > 0 and error.column > 0, ours
    planner = check()
    if (ours is None) == (planner is None):
        return None
    if ours is None:
        return None if CALCULATED in planner else f"only the planner: {planner}"
    return None if any(re.search(pattern, ours) for pattern in STRICTER) else f"only ours: {ours}"


def fault(report):
    """What check_input of planning would say about a report of kairos."""
    fatal = ("dialect.undeclared_predicate", "dialect.undeclared_function")
    errors = [d for d in report.diagnostics if d.severity == kairos.Severity.ERROR or d.code in fatal]
    return errors[0].message if errors else None if report.valid else "invalid"


def of_domain(text):
    return difference(lambda: parse_domain(text, "d"), lambda: fault(kairos.check_domain(text, "d")))


def of_problem(text, domain):
    parsed = parse_domain(domain)
    return difference(
        lambda: parse_problem(text, parsed, "p", constraints=True),
        lambda: fault(kairos.check_problem(text, domain, "p", "d")),
    )


def undecided(seeds):
    pairs = pddl_texts.texts()
    found = []
    for seed in seeds:
        chance = random.Random(seed)
        domain, problem = pairs[seed % len(pairs)]
        if chance.random() < 0.5:
            different = of_domain(pddl_texts.spoilt(domain, chance))
        else:
            different = of_problem(pddl_texts.spoilt(problem, chance), domain)
        if different is not None:
            found.append((seed, different))
    return found


def test_spoilt_domains_and_problems():
    assert undecided(range(400)) == []


@pytest.mark.long
def test_spoilt_domains_and_problems_by_the_thousand():
    assert undecided(range(1_000, 21_000)) == []


@pytest.mark.parametrize("old, new", pddl_texts.SPELLINGS)
def test_spellings(old, new):
    assert old in pddl_texts.DOMAIN
    assert of_domain(pddl_texts.DOMAIN.replace(old, new)) is None


def test_blanks_of_other_alphabets():
    for blank in pddl_texts.BLANKS:
        for text in (
            blank + pddl_texts.DOMAIN,
            pddl_texts.DOMAIN + blank,
            pddl_texts.DOMAIN.replace("?from ?to", f"?from{blank}?to"),
            pddl_texts.DOMAIN.replace("(:types", f";c{blank}(:foo)\n(:types"),
        ):
            assert of_domain(text) is None, repr(blank)


@pytest.mark.parametrize("word", pddl_texts.KEYWORDS)
def test_words_of_pddl_as_names(word):
    for domain, problem in pddl_texts.declared_as(word):
        assert of_domain(domain) is None, domain
        try:
            parse_domain(domain)
        except PddlError:
            continue
        assert of_problem(problem, domain) is None, domain + problem


#: Of a domain with the predicate (p), the number (n) and the action a; whether they are right.
SECTIONS = {
    "(:process b :precondition (p) :effect (and (increase (n) (* #t 1)) (decrease (n) (* (n) #t))))": True,
    "(:process b :effect (when (p) (increase (n) (* #t 1))))": True,
    "(:process b) (:event c) (:event d :precondition () :effect ())": True,
    "(:event b :precondition (> (n) 1) :effect (and (not (p)) (increase (n) 1)))": True,
    "(:process b :effect (increase (n) 1))": False,
    "(:process b :effect (assign (n) (* #t 1)))": False,
    "(:process b :effect (increase (n) (* #t ?duration)))": False,
    "(:process b :effect (p))": False,
    "(:process b :effect (at start (p)))": False,
    "(:process b :duration (= ?duration 1))": False,
    "(:process)": False,
    "(:event a :effect (p))": False,
    "(:event b) (:process b)": False,
    "(:event b :parametrs () :effect (p))": False,
    "(:event b :effect (increase (n) (* #t 1)))": False,
    "(:event b :effect (at end (p)))": False,
    "(:event b :effect (q))": False,
    "(:constraints (always (p)))": True,
    "(:constraints)": False,
    "(:constraints always)": False,
    "(:constraints (always))": False,
    "(:constraints (always (q)))": False,
    "(:constraints (sometimes (p)))": False,
    "(:constraints (within soon (p)))": False,
    "(:constraints (and (sometime (p)) (preference soft (within 5 (> (n) 1)))))": True,
    "(:predicates (r ?x)) (:constraints (forall (?x) (sometime (r ?x))) (sometime (r of-a-problem)))": True,
    "(:constants c - (either object (either object object)))": False,
}


@pytest.mark.parametrize("section, right", SECTIONS.items())
def test_what_no_robot_executes_is_read_too(section, right):
    text = f"(define (domain d) (:predicates (p)) (:functions (n)) (:action a :effect (p)) {section})"
    assert of_domain(text) is None
    if right:
        assert set(parse_domain(text).operators) == {"a"}
    else:
        pytest.raises(PddlError, parse_domain, text)


@settings(max_examples=200, deadline=None)
@given(pddl_texts.typed_domains())
def test_what_fits_where(text):
    assert of_domain(text) is None, text


@pytest.mark.long
@settings(max_examples=5_000, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(pddl_texts.typed_domains())
def test_what_fits_where_by_the_thousand(text):
    assert of_domain(text) is None, text


PATROL = """(define (domain patrol) (:requirements :typing) (:types rover - vehicle rover - heavy site)
(:predicates (on ?v -vehicle ?s - site))
(:action drive :parameters (?v -heavy ?a ?b -site) :precondition (on ?v ?a)
 :effect (and (not (on ?v ?a)) (on ?v ?b))))"""
PATROL_PROBLEM = """(define (problem p) (:domain patrol) (:objects one -rover x y -site) (:init (on one x))
(:goal (forall (?v -rover) (on ?v y))))"""


def test_a_dash_without_a_blank_behind_it_and_types_that_overlap():
    domain = parse_domain(PATROL)
    assert domain.predicates["on"].parameters[0].types == ("vehicle",)
    assert [v.types for v in domain.operators["drive"].parameters] == [("heavy",), ("site",), ("site",)]
    assert parse_problem(PATROL_PROBLEM, domain).objects == {
        "one": ("rover",),
        "x": ("site",),
        "y": ("site",),
    }
    assert check_input(PATROL, PATROL_PROBLEM, "d", "p") is None


def test_types_that_share_nothing_do_not_fit():
    with pytest.raises(PddlError, match=r"'\?v' is of type heavy, but 'on' takes vehicle here"):
        parse_domain(PATROL.replace("rover - heavy", "truck - heavy"))


@pytest.mark.parametrize(
    "old, new, place, reason",
    [
        ("?a ?b", "?a?b", "3:39", "a blank is missing in '?a?b': write '?a ?b'"),
        ("(on ?v ?b)", "(on?v ?b)", "4:33", "a blank is missing in 'on?v': write 'on ?v'"),
        ("?a ?b", "?a- site ?b", "3:43", "write a blank before the '-' of '?a-'"),
        ("?a ?b", "? a ?b", "3:39", "no blank between '?' and the name behind it"),
        (
            "?a ?b",
            "?a\xa0?b",
            "3:39",
            "U+00A0 NO-BREAK SPACE, which may stand in comments only; write an ordinary",
        ),
        ("?a ?b", "?a\x85?b", "3:39", "U+0085, which may stand in comments only"),
        ("site)\n", "site)\r; ü\r\n", "", ""),
        ("(on ?v ?a)", "(> .5 0)", "3:69", "a number has digits on both sides of its point"),
    ],
)
def test_the_error_names_the_blank_that_is_missing(tmp_path, old, new, place, reason):
    file = tmp_path / "domain.pddl"
    file.write_bytes(PATROL.replace(old, new, 1 if place != "4:33" else -1).encode())
    if not reason:
        assert list(read_domain(file).operators) == ["drive"]
        return
    with pytest.raises(PddlError) as caught:
        read_domain(file)
    assert str(caught.value).startswith(f"{file}:{place}: ") and reason in str(caught.value)


def test_a_bound_of_a_duration_names_its_missing_blank():
    text = pddl_texts.DOMAIN.replace("(= ?duration 10)", "(=?duration 10)")
    with pytest.raises(PddlError, match=r"a blank is missing in '=\?duration': write '= \?duration'"):
        parse_domain(text)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_a_byte_that_is_not_utf8_is_named_with_its_line(tmp_path, end):
    file = tmp_path / "domain.pddl"
    file.write_bytes(PATROL.replace("\n", end, 1).encode() + f"{end}; k\xfchn".encode("latin-1"))
    with pytest.raises(
        PddlError, match=r"domain.pddl:5:4: the byte 0xfc is not UTF-8.*save the file as UTF-8"
    ):
        read_domain(file)


def test_a_byte_order_mark_and_other_line_ends_are_read(tmp_path):
    for number, end in enumerate(("\n", "\r\n", "\r")):
        domain, problem = tmp_path / f"d{number}.pddl", tmp_path / f"p{number}.pddl"
        domain.write_bytes(b"\xef\xbb\xbf" + PATROL.replace("\n", f"; c{end}").encode())
        problem.write_bytes(b"\xef\xbb\xbf" + PATROL_PROBLEM.replace("\n", end).encode())
        assert read_problem(problem, read_domain(domain)).objects["one"] == ("rover",)
        assert parse_domain("\ufeff" + PATROL).name == "patrol"
