# SPDX-License-Identifier: Apache-2.0
"""Domains and problems, right and spoilt, for the test that compares our reader with the planner's."""

import random
import re
from pathlib import Path
from typing import Iterator, List, Tuple

from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[3]
FILES = [
    ("pddl/home/domain.pddl", "pddl/home/problem.pddl"),
    ("pddl/home/robots.pddl", "pddl/home/robots_problem.pddl"),
    ("pddl/restaurant/domain.pddl", "pddl/restaurant/problem.pddl"),
    ("pddl/robots/domain.pddl", "pddl/robots/problem.pddl"),
    ("test/data/pddl/workshop.pddl", "test/data/pddl/workshop_problem.pddl"),
    ("test/execution/cellar.pddl", "test/execution/cellar_problem.pddl"),
]

#: A little of everything that a domain and a problem may have.
DOMAIN = """(define (domain d) (:requirements :adl :durative-actions :fluents :derived-predicates)
(:types robot place - object room - place)
(:constants home - place)
(:predicates (at ?r - robot ?p - place) (free ?p - place) (near ?x - (either robot place)) (calm))
(:functions (fuel ?r - robot) (total-cost) - number)
(:derived (calm) (exists (?r - robot) (or (at ?r home) (not (free home)))))
(:action go :parameters (?r - robot ?from ?to - place)
 :precondition (and (at ?r ?from) (> (fuel ?r) 1) (imply (calm) (free ?to)))
 :effect (and (not (at ?r ?from)) (at ?r ?to) (decrease (fuel ?r) 1) (increase (total-cost) 2.5)
  (forall (?q - robot) (when (at ?q ?to) (near ?q)))))
(:durative-action fly :parameters (?r - robot ?from ?to - place) :duration (= ?duration 10)
 :condition (and (at start (at ?r ?from)) (over all (free ?to)) (at end (>= (fuel ?r) 0)))
 :effect (and (at start (not (at ?r ?from))) (at end (at ?r ?to)) (decrease (fuel ?r) (* #t 0.1)))))"""
PROBLEM = """(define (problem p) (:domain d) (:objects r1 - robot a - place b - room)
(:init (at r1 a) (free a) (not (free b)) (= (fuel r1) 5) (= (total-cost) 0) (at 5 (free b)))
(:goal (and (at r1 b) (not (calm)) (preference q (free a)) (< (fuel r1) (* 2 3))))
(:metric minimize (+ (total-time) (* 3 (is-violated q)))))"""

#: Words that mean something in PDDL: each is a name somewhere in somebody's domain.
KEYWORDS = [
    "start",
    "end",
    "at",
    "all",
    "over",
    "and",
    "or",
    "not",
    "imply",
    "forall",
    "exists",
    "when",
    "either",
    "preference",
    "is-violated",
    "increase",
    "decrease",
    "assign",
    "scale-up",
    "scale-down",
    "define",
    "domain",
    "problem",
    "minimize",
    "maximize",
    "total-time",
    "total-cost",
    "duration",
    "object",
    "number",
    "always",
    "sometime",
    "within",
    "at-most-once",
    "sometime-after",
    "sometime-before",
    "hold-after",
    "hold-during",
    "always-within",
    "undefined",
    "string",
    "action",
    "derived",
    "durative-action",
    "types",
    "inf",
    "nan",
    "e",
    "e5",
    "t",
    "_",
    "init",
    "goal",
    "metric",
]
_WORDS = KEYWORDS + [
    "?duration",
    "#t",
    "=",
    ">",
    ">=",
    "<",
    "<=",
    "+",
    "-",
    "*",
    "/",
    "(",
    ")",
    "()",
    "1",
    "0.5",
    "-1",
    "1e3",
    ".5",
    "5.",
    "1e400",
    "1e-400",
    "?x",
    ":action",
    ":durative-action",
    ":types",
    ":predicates",
    ":functions",
    ":parameters",
    ":precondition",
    ":condition",
    ":effect",
    ":duration",
    ":init",
    ":goal",
    ":metric",
    ":objects",
    ":constraints",
    ":derived",
    ":requirements",
]
#: What stands between words in other people's files, some of it by mistake.
BLANKS = [
    *("\t", "\r", "\r\n", "\n", "\f", "\v", "", "  ", ";c\r", ";\xfc\n"),
    *("\xa0", "\x85", "\u2003", "\u3000", "\x1c", "\x1f", "\u2028", "\u200b", "\u202f", "\ufeff", "\0"),
]
_SIGNS = "-?:_.@#=;()'\"1aé"

#: (what stands in DOMAIN, what is written instead)
SPELLINGS = [
    *((" - robot", spelled) for spelled in (" -robot", "- robot", "-robot", " - - robot", " -\trobot")),
    *(("?from ?to", spelled) for spelled in ("?from?to", "?from\t?to", "? from ?to", "?From ?TO", "?1 ?to")),
    *(("(= ?duration 10)", text) for text in ("(=?duration 10)", "(= 10 ?duration)", "()", "(and)")),
    *(
        ("?duration 10", f"?duration {n}")
        for n in ("1e1", ".5", "5.", "+5", "-5", "1_0", "0x1", "inf", "1,5")
    ),
    *(
        ("?duration 10", f"?duration {n}")
        for n in ("1e400", "1e-400", "٣", "00010", "1E+1", "?duration", "#t")
    ),
    *(("(= ?duration 10)", f"({when} (= ?duration 10))") for when in ("at start", "at end", "over all")),
    *(("(at ?r ?to)", text) for text in ("(at?r ?to)", "(At ?R ?TO)", "(at ?r\xa0?to)", "(at ?r;ü\r?to)")),
    *((" room - place)", f" {text})") for text in ("room room", "room - place room - robot", "- place room")),
    *((" room - place)", f" {text})") for text in ("room", "room - (either place robot)", "room - room")),
    *(
        ("(:types", f"(:types) {text} (:types")
        for text in ("()", "x", "(:constants)", "(:functions)", "(:foo)")
    ),
    *(
        ("(free ?p - place)", f"(free ?p - place) {text}")
        for text in ("(free ?p - place)", "(FREE ?p)", "(f.g)")
    ),
    *(
        ("(fuel ?r - robot)", f"(fuel ?r - robot) {text}")
        for text in ("(fuel ?r - robot)", "(fuel)", "(calm)")
    ),
    *(
        ("home - place)", f"{text})")
        for text in ("home - place home - robot", "home home - place", "home - no")
    ),
    *(("(* #t 0.1)", text) for text in ("1", "#t", "(* 0.1 #t)", "(+ 1 2)", "?duration", "total-time")),
    *(
        ("(over all (free ?to))", f"({op} (over all (free ?to)))")
        for op in ("not", "or", "and", "preference p")
    ),
    *((":adl", text) for text in ("adl", "(:adl)", ":ADL", ":unheard-of", "")),
    ("(increase (total-cost) 2.5)", "(increase (total-cost) ?duration)"),
    ("(domain d)", "(domain d.2)"),
]


def declared_as(word: str) -> Iterator[Tuple[str, str]]:
    """The domain and its problem with one name replaced by a word, in every place of each kind of name."""
    for name in ("room", "free", "fuel", "home", "go", "fly", r"\?from", "d", "calm", "r1", "p"):
        pattern = rf"(?<![\w?:-]){name}(?![\w-])"
        new = ("?" if name.startswith(r"\?") else "") + word
        yield re.sub(pattern, new, DOMAIN), re.sub(pattern, new, PROBLEM)


def texts() -> List[Tuple[str, str]]:
    """Domains and problems as they are."""
    read = [tuple((ROOT / name).read_text(encoding="utf-8") for name in pair) for pair in FILES]
    return [(DOMAIN, PROBLEM), *read]


def spoilt(text: str, chance: random.Random) -> str:
    """A text with a mistake or two."""
    return chance.choice((_words, _signs, _groups))(text, chance)


def _split(text: str) -> List[str]:
    return re.findall(r"[()]|[^\s()]+", re.sub(r";[^\n]*", "", text))


def _words(text: str, chance: random.Random) -> str:
    words = _split(text)
    for _ in range(chance.randint(1, 2)):
        place, act = chance.randrange(len(words)), chance.randrange(6)
        if act == 0:
            del words[place]
        elif act == 1:
            other = chance.randrange(len(words))
            words[place], words[other] = words[other], words[place]
        else:
            kept = act % 2  # one more word, or another one
            words[place : place + kept] = [chance.choice(words if act < 4 else _WORDS)]
    return " ".join(words)


def _signs(text: str, chance: random.Random) -> str:
    for _ in range(chance.randint(1, 2)):
        place, act = chance.randrange(len(text)), chance.randrange(6)
        blank = chance.choice([found.start() for found in re.finditer(r"\s", text)])
        dash = chance.choice([found.start() for found in re.finditer(" - ", text)] or [0])
        if act == 0:
            text = text[:place] + text[place + 1 :]
        elif act == 1:
            text = text[:place] + chance.choice(BLANKS) + text[place:]
        elif act == 2:
            text = text[:blank] + chance.choice(BLANKS) + text[blank + 1 :]
        elif act == 3:
            text = text[:place] + text[place].swapcase() + text[place + 1 :]
        elif act == 4:
            text = text[:place] + chance.choice(_SIGNS) + text[place:]
        elif dash:
            text = text[:dash] + chance.choice([" -", "- ", "-", " - - ", " "]) + text[dash + 3 :]
    return text


def _groups(text: str, chance: random.Random) -> str:
    """Something in parentheses is left out, doubled, or stands elsewhere."""
    words = _split(text)
    begins = [place for place, word in enumerate(words) if word == "(" and place]
    here, there = chance.choice(begins), chance.choice(begins)
    group = words[here : _end(words, here)]
    act = chance.randrange(4)
    if act < 2:
        words[here : here + act * len(group)] = group if act == 0 else []
    else:
        words[there : there if act == 2 else _end(words, there)] = group
    return " ".join(words)


def _end(words: List[str], begin: int) -> int:
    depth = 0
    for place in range(begin, len(words)):
        depth += (words[place] == "(") - (words[place] == ")")
        if depth == 0:
            return place + 1
    return len(words)


_TYPE = st.sampled_from(["a", "b", "c", "object"])
_TYPES = st.one_of(_TYPE, st.lists(_TYPE, min_size=1, max_size=2).map(lambda t: f"(either {' '.join(t)})"))
_TERM = st.sampled_from(["?x", "?y", "?x", "?y", "?x", "?y", "k"])
_ATOM = st.one_of(st.builds("(p {})".format, _TERM), st.builds("(q {} {})".format, _TERM, _TERM))
_NUMBER = st.sampled_from(
    ["1", "(f ?x)", "(f k)", "(- (f ?y))", "(+ 1 (f ?x))", "2", "(f ?y)", "?duration", "#t"]
)
_CONDITION = st.recursive(
    st.one_of(
        _ATOM, st.builds("(= {} {})".format, _TERM, _TERM), st.builds("(> {} {})".format, _NUMBER, _NUMBER)
    ),
    lambda part: st.one_of(
        st.builds("(not {})".format, part),
        st.builds("(preference w {})".format, part),
        st.builds("({} {} {})".format, st.sampled_from(["and", "or", "imply"]), part, part),
        st.builds("({} (?x - {}) {})".format, st.sampled_from(["forall", "exists"]), _TYPES, part),
    ),
    max_leaves=4,
)


@st.composite
def typed_domains(draw: st.DrawFn) -> str:
    """Small domains, most of them right, about what fits where: types, `either`, terms, special values."""
    above = {"c": [" - object", " - a", " - b", " - (either a b)"], "b": [" - object", " - a"], "a": [""]}
    types = " ".join(name + draw(st.sampled_from(parents)) for name, parents in above.items())
    more = draw(st.sampled_from(["", "c - a ", "c - object ", "b - a "]))
    condition, effect = draw(_CONDITION), draw(_ATOM)
    change = draw(st.builds("({} (f {}) {})".format, st.sampled_from(["assign", "increase"]), _TERM, _NUMBER))
    head = (
        f"(define (domain d) (:requirements :adl :fluents) (:types {more}{types})"
        f" (:constants k - {draw(_TYPES)})"
        f" (:predicates (p ?x - {draw(_TYPES)}) (q ?x - {draw(_TYPES)} ?y - {draw(_TYPES)}))"
        f" (:functions (f ?x - {draw(_TYPES)}))"
    )
    given = f":parameters (?x - {draw(_TYPES)} ?y - {draw(_TYPES)})"
    if draw(st.booleans()):
        return f"{head} (:action go {given} :precondition {condition} :effect (and {effect} {change})))"
    when = st.sampled_from(["at start", "at end", "over all"])
    timed = change if draw(st.booleans()) else f"({draw(when)} {change})"
    return (
        f"{head} (:durative-action go {given} :duration (= ?duration {draw(_NUMBER)})"
        f" :condition ({draw(when)} {condition}) :effect (and ({draw(when)} {effect}) {timed})))"
    )
