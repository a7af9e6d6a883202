# SPDX-License-Identifier: Apache-2.0
"""What has to happen with which plan: domains of a few lines, plans, and expectations.

An expectation is ``0e<1s`` (the end of action 0 before the start of action 1), ``0e>5`` (after 5 s), ``0|1`` (the
esterel dispatcher runs them at the same time), ``simple fails TEXT`` or ``esterel fails TEXT`` (words of the
reason, joined by dots), or ``drift``: other durations than the planned ones, or one action after the other, may
fail it. What every case has to satisfy besides, unless it fails: PDDL 2.1, and its goal.
"""

# ruff: noqa: E501

import re
from typing import List, NamedTuple, Optional

from merlin_pddl.plan_text import PlanStep, parse_plan

FACTS = ["a", "b", "c", "lit", "lit2", "unused", "unused2", "free"] + [f"f{number}" for number in range(6)]


class Case(NamedTuple):
    """:param domain: actions in short form, see `sections`."""

    name: str
    domain: str
    init: str
    plan: str
    goal: str
    expect: str


def sections(domain: str) -> str:
    """The sections of a domain with some actions, with all that any case uses."""
    return (
        f"(:types thing) (:predicates {' '.join(f'({fact})' for fact in FACTS)} (d)) (:functions (x) (y)) "
        f"(:derived (d) (or (a) (a)))\n{domain}"
    )


def plan_of(case: Case) -> List[PlanStep]:
    """The plan of a case."""
    lines = []
    for part in filter(None, case.plan.split("|")):
        time, name, duration = part.split()
        lines.append(f"{time}: ({name}) [{duration}]")
    return parse_plan("\n".join(lines))


def failure_of(case: Case, kind: str) -> Optional[str]:
    """What the reason has to say if a kind of dispatcher has to fail."""
    found = re.search(rf"{kind} fails (\S+)", case.expect)
    return found.group(1).replace(".", " ") if found else None


def plain(name: str, condition: str, effect: str) -> str:
    return f"(:action {name} :parameters () :precondition (and {condition}) :effect (and {effect}))\n"


def lasting(
    name: str, start: str = "", over: str = "", end: str = "", begins: str = "", ends: str = ""
) -> str:
    """:param start, over, end: conditions.
    :param begins, ends: effects.
    """

    def at(when: str, parts: str) -> str:
        return f"({when} (and {parts})) " if parts else ""

    return (
        f"(:durative-action {name} :parameters () :duration (>= ?duration 0) :condition (and "
        f"{_each('at start', start)}{_each('over all', over)}{_each('at end', end)}) :effect (and "
        f"{_each('at start', begins)}{_each('at end', ends)}))\n"
    )


def _each(when: str, parts: str) -> str:
    depth, begin, found = 0, 0, ""
    for index, sign in enumerate(parts):
        depth += (sign == "(") - (sign == ")")
        if sign == "(" and depth == 1:
            begin = index
        if sign == ")" and depth == 0:
            found += f"({when} {parts[begin : index + 1]}) "
    return found


DOUBLE = plain("double", "", "(increase (x) (x))")
COPY = plain("copy", "", "(assign (y) (x))")
MATCH = lasting("light", "(unused)", "", "", "(lit) (not (unused))", "(not (lit))")
MATCH2 = lasting("light2", "(unused2)", "", "", "(lit2) (not (unused2))", "(not (lit2))")
MEND = lasting("mend", "(free)", "(lit)", "", "(not (free))", "(free) (a)")
MEND2 = lasting("mend2", "(free)", "(lit2)", "", "(not (free))", "(free) (b)")
GIVE = lasting("give", ends="(a)")
TAKE = lasting("take", "(a)", ends="(b)")
KEEP = lasting("keep", over="(a)", ends="(b)")
BREAK = lasting("break", begins="(not (a))", ends="(c)")
SPOIL = lasting("spoil", ends="(not (a)) (c)")

CASES: List[Case] = [
    Case("plain in order", plain("one", "", "(a)") + plain("two", "(a)", "(b)"), "", "0 one 3|0.001 two 3", "(b)", "0e<1s"),
    Case("plain, nothing shared", plain("one", "", "(a)") + plain("two", "", "(b)"), "", "0 one 3|0 two 3", "(and (a) (b))", "0|1"),
    Case("plain, both consume", plain("one", "(c)", "(a) (not (c))") + plain("back", "(a)", "(c)") + plain("two", "(c)", "(b) (not (c))"), "(c)", "0 one 3|1 back 3|2 two 3", "(and (a) (b))", "0e<1s 1e<2s"),
    Case("plain, deleted after use", plain("use", "(c)", "(a)") + plain("drop", "", "(not (c)) (b)"), "(c)", "0 use 3|1 drop 1", "(and (a) (b))", "0e<1s"),
    Case("double then copy", DOUBLE + COPY, "(= (x) 2) (= (y) 0)", "0 double 3|1 copy 3", "(= (y) 4)", "0e<1s"),
    Case("copy then double", DOUBLE + COPY, "(= (x) 2) (= (y) 0)", "0 copy 3|1 double 1", "(and (= (y) 2) (= (x) 4))", "0e<1s"),
    Case("double twice", DOUBLE, "(= (x) 2)", "0 double 3|1 double 3", "(= (x) 8)", "0e<1s"),
    Case("increases commute", plain("one", "", "(increase (x) 1)") + plain("two", "", "(increase (x) 2)"), "(= (x) 0)", "0 one 3|1 two 3", "(= (x) 3)", "0|1"),
    Case("increase, then read", plain("one", "", "(increase (x) 5)") + plain("two", "(>= (x) 5)", "(a)"), "(= (x) 0)", "0 one 3|1 two 3", "(a)", "0e<1s"),
    Case("assign, assign", plain("one", "", "(assign (x) 1)") + plain("two", "", "(assign (x) 2)"), "(= (x) 0)", "0 one 3|1 two 1", "(= (x) 2)", "0e<1s"),
    Case("plain, conditional effect", plain("one", "", "(a)") + plain("two", "", "(when (a) (b))"), "", "0 one 3|1 two 1", "(b)", "0e<1s"),
    Case("plain, disjunction", plain("one", "", "(a)") + plain("two", "(or (a) (c))", "(b)"), "", "0 one 3|1 two 1", "(b)", "0e<1s"),
    Case("end effect needed", GIVE + TAKE, "", "0 give 3|3.001 take 2", "(b)", "0e<1s"),
    Case("start effect needed", lasting("open", begins="(a)", ends="(c)") + TAKE, "", "0 open 5|0.001 take 2", "(and (b) (c))", "0s<1s 0|1"),
    Case("over all, broken later", KEEP + BREAK, "(a)", "0 keep 3|3 break 1", "(and (b) (c))", "0e<1s"),
    Case("over all, broken by an end", KEEP + SPOIL, "(a)", "0 keep 3|0 spoil 5", "(and (b) (c))", "0e<1e"),
    Case("over all, brought about at the same time", lasting("open", begins="(a)", ends="(not (a))") + KEEP, "", "0 keep 3|0 open 5", "(b)", "1s<0s drift simple fails does.not.hold"),
    Case("two that need the same fact", KEEP + lasting("also", over="(a)", ends="(c)"), "(a)", "0 keep 3|0 also 5", "(and (b) (c))", "0|1"),
    Case("deleted, added, needed", lasting("drop", begins="(not (a))") + GIVE + TAKE, "(a)", "0 drop 1|0.5 give 3|3.6 take 1", "(b)", "0s<1e 1e<2s"),
    Case("the last one decides: add", GIVE + SPOIL, "(a)", "0 spoil 2|0 give 5", "(and (a) (c))", "0e<1e"),
    Case("the last one decides: delete", GIVE + SPOIL, "", "0 give 2|0 spoil 5", "(and (not (a)) (c))", "0e<1e"),
    Case("at-end condition", GIVE + lasting("await", end="(a)", ends="(b)"), "", "0 give 3|0 await 5", "(b)", "0e<1e"),
    Case("at-end condition that its own end breaks", GIVE + lasting("use", end="(a)", ends="(not (a)) (b)"), "", "0 give 3|0 use 5", "(b)", "0e<1e"),
    Case("an end without its condition", lasting("use", end="(a)", ends="(a) (b)"), "", "0 use 3", "(b)", "simple fails at.its.end esterel fails at.its.end"),
    Case("negative over all", lasting("keep", over="(not (a))", ends="(b)") + GIVE, "", "0 keep 3|1 give 4", "(and (a) (b))", "0e<1e"),
    Case("a match and a fuse", MATCH + MEND, "(unused) (free)", "0 light 8|0.001 mend 5", "(a)", "0s<1s 1e<0e drift simple fails does.not.hold"),
    Case("a second match waits", MATCH + MATCH2 + MEND + MEND2, "(unused) (unused2) (free)", "0 light 8|0.001 mend 5|1.002 light2 8|5.002 mend2 3.9", "(and (a) (b))", "1e<2s 3e<2e drift simple fails does.not.hold"),
    Case("an early match, a long wait", MATCH + MEND + lasting("fetch", ends="(free)"), "(unused)", "0 fetch 20|13 light 8|20.001 mend 0.9", "(a)", "0e<1s drift simple fails does.not.hold"),
    Case("a start inside, an end inside", lasting("long", begins="(a)", ends="(b) (not (a))") + lasting("late", "(a)", end="(b)", ends="(c)"), "", "0 long 10|8 late 4", "(c)", "0s<1s 1s<0e 0e<1e 1s>7 drift simple fails does.not.hold"),
    Case("nested windows", lasting("outer", begins="(a)", ends="(not (a))") + lasting("inner", "(a)", begins="(b)", ends="(not (b))") + lasting("core", over="(b)", ends="(c)"), "", "0 outer 20|0.1 inner 10|0.2 core 5", "(c)", "0s<1s 1s<2s 2e<1e drift simple fails does.not.hold"),
    Case("a timed fact", TAKE, "(at 7 (a))", "7.1 take 2", "(b)", "0s>7"),
    Case("a timed value", lasting("cook", "(>= (x) 10)", ends="(b)"), "(= (x) 0) (at 12.5 (= (x) 20))", "12.6 cook 2", "(b)", "0s>12.5"),
    Case("a timed value over all", lasting("cook", over="(>= (x) 10)", ends="(b)"), "(= (x) 20) (at 3 (= (x) 0)) (at 12.5 (= (x) 20))", "12.6 cook 2", "(b)", "0s>12.5 drift"),
    Case("a timed value that is not needed", lasting("cook", "(>= (x) 10)", ends="(b)"), "(= (x) 15) (at 12.5 (= (x) 20))", "12.6 cook 2", "(b)", "0s<1"),
    Case("a timed value in an equation", lasting("cook", "(= (x) 20)", ends="(b)"), "(= (x) 0) (at 12.5 (= (x) 20))", "12.6 cook 2", "(b)", "0s>12.5"),
    Case("an effect behind a timed change to the opposite", lasting("set", begins="(a)", ends="(c)") + KEEP, "(at 3 (not (a)))", "5 set 2|5.1 keep 6", "(and (b) (c))", "0s>3 drift"),
    Case("a timed fact inside a window", MATCH + lasting("mend", "(c)", "(lit)", ends="(a)"), "(unused) (at 9 (c))", "4 light 8|9.1 mend 2", "(a)", "0s>3.9 1s>9 drift simple fails does.not.hold"),
    Case("a timed fact at an end", lasting("wait", end="(a)", ends="(b)"), "(at 9 (a))", "4 wait 6", "(b)", "0s>3.9 drift"),
    Case("a condition that never holds", TAKE, "", "0 take 2", "(b)", "simple fails (a).does.not.hold esterel fails (a).does.not.hold"),
    Case("a timed fact planned too late", TAKE, "(at 50 (a))", "7 take 2", "(b)", "simple fails (a).does.not.hold esterel fails (a).does.not.hold"),
    Case("nothing to do", TAKE, "(b)", "", "(b)", ""),
    Case("zero durations", GIVE + TAKE, "", "0 give 0|0.001 take 0", "(b)", "0e<1s"),
    Case("a chain of five", "".join(lasting(f"s{i}", f"(f{i})", ends=f"(f{i + 1})") for i in range(5)), "(f0)", "0 s0 1|1 s1 1|2 s2 1|3 s3 1|4 s4 1", "(f5)", "0e<1s 1e<2s 2e<3s 3e<4s"),
    Case("a fork and a join", lasting("p", ends="(a)") + lasting("q", ends="(b)") + lasting("r", "(a) (b)", ends="(c)"), "", "0 p 2|0 q 5|5.1 r 1", "(c)", "0|1 0e<2s 1e<2s"),
    Case("a resource of one", "".join(lasting(f"u{i}", "(free)", begins="(not (free))", ends=f"(free) (f{i})") for i in range(3)), "(free)", "0 u0 3|3.1 u1 3|6.2 u2 3", "(and (f0) (f1) (f2))", "0e<1s 1e<2s"),
    Case("a battery", "".join(lasting(f"u{i}", "(>= (x) 4)", begins="(decrease (x) 4)", ends=f"(f{i})") for i in range(2)), "(= (x) 9)", "0 u0 3|0.1 u1 3", "(and (f0) (f1))", "0s<1s 0|1"),
    Case("charging between", lasting("use", "(>= (x) 4)", begins="(decrease (x) 4)", ends="(a)") + lasting("charge", ends="(increase (x) 4)") + lasting("again", "(>= (x) 4)", ends="(b)"), "(= (x) 4)", "0 use 3|0.1 charge 5|5.2 again 1", "(and (a) (b))", "1e<2s"),
    Case("a start that changes nothing", lasting("set", begins="(assign (x) 1)", ends="(a)") + lasting("get", "(<= (x) 1)", ends="(b)"), "(= (x) 1)", "0 set 5|0.1 get 1", "(and (a) (b))", "0s<1s 0|1"),
    Case("quantified", GIVE + lasting("all", "(forall (?o - thing) (a))", ends="(b)"), "", "0 give 3|3.1 all 1", "(b)", "0e<1s"),
    Case("conditional effect at an end", GIVE + lasting("maybe", ends="(when (a) (b))"), "", "0 give 3|0.1 maybe 5", "(b)", "0e<1e"),
    Case("derived", GIVE + lasting("use", "(d)", ends="(b)"), "", "0 give 3|3.1 use 1", "(b)", "0e<1s"),
    Case("derived over all", lasting("use", over="(d)", ends="(b)") + SPOIL, "(a)", "0 use 3|0 spoil 5", "(and (b) (c))", "0e<1e"),
    Case("out of order in the text", TAKE + GIVE, "", "3.1 take 1|0 give 3", "(b)", "0e<1s"),
    Case("mixed plain and durative", plain("one", "", "(a)") + KEEP + plain("off", "", "(not (a)) (c)"), "", "0 one 2|0.1 keep 3|3.2 off 2", "(and (b) (c))", "0e<1s 1e<2s"),
    Case("plain inside a window", lasting("open", begins="(a)", ends="(not (a))") + plain("use", "(a)", "(b)"), "", "0 open 5|1 use 1", "(b)", "0s<1s 1e<0e drift simple fails does.not.hold"),
    Case("two windows, one action", MATCH + MATCH2 + lasting("both", over="(lit) (lit2)", ends="(a)"), "(unused) (unused2)", "0 light 8|0.01 light2 8|0.1 both 5", "(a)", "0s<2s 1s<2s 2e<0e 2e<1e drift simple fails does.not.hold"),
    Case("an end that no one needs", GIVE + lasting("idle"), "", "0 give 3|0 idle 9", "(a)", "0|1"),
    Case("scale", plain("one", "", "(scale-up (x) 2)") + plain("two", "", "(increase (x) 1)"), "(= (x) 3)", "0 one 3|1 two 1", "(= (x) 7)", "0e<1s"),
    Case("added twice", GIVE + lasting("more", ends="(a)") + TAKE, "", "0 give 2|0 more 3|3.1 take 1", "(b)", "1e<2s"),
    Case("its own end breaks it", lasting("burn", over="(a)", begins="(a)", ends="(not (a)) (b)"), "", "0 burn 3", "(b)", ""),
    Case("its own conditional start", lasting("burn", over="(a)", begins="(when (c) (a))", ends="(b)"), "(c)", "0 burn 3", "(b)", ""),
    Case("deleted and added at once", lasting("renew", "(a)", begins="(not (a))", ends="(a) (b)"), "(a)", "0 renew 3|3.1 renew 3", "(and (a) (b))", "0e<1s"),
    Case("parallel, then one that needs none of both", lasting("p", ends="(not (a))") + lasting("q", ends="(not (b))") + lasting("r", "(not (a)) (not (b))", ends="(c)"), "(a) (b)", "0 p 2|0 q 3|3.1 r 1", "(c)", "0|1 0e<2s 1e<2s"),
]  # fmt: skip
