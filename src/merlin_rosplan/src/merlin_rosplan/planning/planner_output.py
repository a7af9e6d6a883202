# SPDX-License-Identifier: Apache-2.0
"""What planners print: POPF, OPTIC, FF, Metric-FF, LPG, Fast Downward, TFD, SMTPlan, Tamer and others.

A planner is recognised by what it prints and not by its name, so a wrapper script around one works too.
"""

import json
import re
from typing import Iterable, List, NamedTuple, Optional, Tuple

from merlin_pddl.plan_text import NO_DURATION, PlanStep, parse_line
from merlin_rosplan.planning.planning_outcome import PlannerState

Plan = List[PlanStep]


class NoPlan(NamedTuple):
    """Why there is no plan."""

    state: PlannerState
    reason: str


_FF_PLAN = re.compile(r"ff: found legal plan", re.IGNORECASE)
_FF_STEP = re.compile(r"^\s*(?:step)?\s*(\d+):\s*([A-Za-z][^()\[\]]*?)\s*$")
_FD_PLAN = re.compile(r"^(?:\[t=[^\]]*\]\s*)?Actual search time", re.MULTILINE)
_FD_STEP = re.compile(r"^([a-z][^()\[\]:]*?)\s+\((\d+)\)\s*$")
_ENHSP_PLAN = re.compile(r"^Found Plan:", re.MULTILINE | re.IGNORECASE)
_ENHSP_STEP = re.compile(r"^\d+(?:\.\d+)?:\s*(\([^()]+\))\s*$")
_FILE_STEP = re.compile(r"^\s*\(([^()]+)\)\s*$")
_HEADING = re.compile(r";+\s*(?:Plan|Solution|better plan|Time|Cost)", re.IGNORECASE)
_SOLVED_MARK = re.compile(
    r"; Plan found|;;;; Solution Found|goal can be simplified to TRUE|"
    r"The empty plan solves it|^Solution found",
    re.IGNORECASE | re.MULTILINE,
)
# Said with a proof: an empty relaxation, or a search of every state that counts as complete for its planner.
_UNSOLVABLE = re.compile(
    r"^.*(?:problem unsolvable|unsolvable problem|deemed unsolvable|detected as unsolvable|"
    r"problem proven unsolvable|problem is unsolvable|problem not solvable|"
    r"goal can be simplified to FALSE|no plan will solve it|no plan exists|provably unsolvable|"
    r"trivially false goal|no relaxed solution|unsolvable_proven|"
    r"goals? .*(?:cannot|can not|can't|not) (?:be )?reach(?:ed|able)|kairos: unsolvable).*$",
    re.IGNORECASE | re.MULTILINE,
)
# The planner gave up: its search was not complete, or bounded.
_NO_PLAN = re.compile(
    r"^.*(?:completely explored state space|search stopped without finding a solution|"
    r"unsolvable_incompletely|kairos: no plan|search space empty|search limit exceeded|"
    r"no (?:plan|solution) (?:was |could be |has been )?found|"
    r"(?:unable to|cannot|can't|could not|did not) find (?:a|any) (?:plan|solution)).*$",
    re.IGNORECASE | re.MULTILINE,
)
_TIME = re.compile(
    r"^.*(?:(?:time ?limit|time-?out|max(?:imum)?(?: cpu| search)? time).*(?:reached|exceeded|expired)|"
    r"no (?:plan|solution) .*time ?limit|status: timeout|caught signal 24|SIGXCPU).*$",
    re.IGNORECASE | re.MULTILINE,
)
_BAD_INPUT = re.compile(
    r"^(?:Reason: )?.*(?:syntax error|Invalid requirement|parse error|parsing error|undeclared|"
    r"unknown (?:predicate|type|constant|object|function|symbol)|"
    r"error: .*(?:expected|undefined)|line: ?\d+: error|pddl:\d+:\d+: error).*$",
    re.IGNORECASE | re.MULTILINE,
)
_MEMORY = re.compile(r"^.*(?:out of memory|bad_alloc|memory limit|cannot allocate memory).*$", re.I | re.M)
_NUMBERED = re.compile(r"(\d+)(?!.*\d)")
_PLAN_FILES = ("sas_plan", "fdplan", "tfdplan", "lpgplan", "plan", "found_plan", "output")

# Fast Downward's exit codes, as its documentation lists them.
_FAST_DOWNWARD_EXIT = {
    10: (PlannerState.UNSOLVABLE, "the translator proved that the problem has no plan"),
    11: (PlannerState.UNSOLVABLE, "the search proved that the problem has no plan"),
    12: (PlannerState.NO_PLAN, "the search ended without a plan; this is not a proof that there is none"),
    20: (PlannerState.CRASHED, "the translator ran out of memory"),
    21: (PlannerState.TIMEOUT, "the translator ran out of time"),
    22: (PlannerState.CRASHED, "the search ran out of memory"),
    23: (PlannerState.TIMEOUT, "the search ran out of time"),
    24: (PlannerState.TIMEOUT, "the search ran out of memory and time"),
    31: (PlannerState.INVALID, "the translator does not accept the input"),
    33: (PlannerState.INVALID, "the search does not accept the input"),
    34: (PlannerState.CRASHED, "the search does not support a feature of the task"),
}


def candidate_plans(output: str, files: Iterable[Tuple[str, str]] = ()) -> List[Plan]:
    """The plans that a planner left behind, the one to prefer first.

    An anytime planner that was stopped may have been printing: its last plan can be cut off. So there are
    several candidates, and the first one that validates is the plan.

    :param output: what it printed.
    :param files: (name, content) of the files it wrote.
    """
    plans: List[Plan] = []
    for _, content in sorted(
        (entry for entry in files if is_plan_file(entry[0])), key=lambda entry: _file_order(entry[0])
    ):
        blocks = _timed_blocks(content)
        if blocks:
            plans.append(blocks[-1])
        else:
            steps = _sequential(_FILE_STEP, content.splitlines())
            if steps or re.search(r"^;\s*cost\s*=", content, re.MULTILINE):
                plans.append(steps)
    if _FF_PLAN.search(output):
        plans.extend(_ff_plans(output))
    elif _FD_PLAN.search(output):
        plans.extend(_fast_downward_plans(output))
    plans.extend(_enhsp_plans(output))
    plans.extend(_kairos_plans(output))
    plans.extend(_timed_blocks(output))
    if not plans and re.search(r"^;\s*cost\s*=", output, re.MULTILINE):
        last = re.split(r"^;\s*cost\s*=.*$", output, flags=re.MULTILINE)[-1]
        plans.append(_sequential(_FILE_STEP, last.splitlines()))
    if not plans and _SOLVED_MARK.search(output):
        plans.append([])
    plans.reverse()
    return plans


def is_plan_file(name: str) -> bool:
    """Whether a file's name is one that planners give to their plans."""
    return name.lower().startswith(_PLAN_FILES) or name.upper().endswith(".SOL")


def verdict(output: str, errors: str, returncode: int, name: str = "") -> Optional[NoPlan]:
    """The reason that a planner gave for leaving no plan; None when it gave none.

    :param output, errors: what it printed.
    :param returncode: its exit code, minus a signal's number.
    :param name: of the program; only Fast Downward's exit codes say more than that it failed.
    """
    text = output + "\n" + errors
    found = _UNSOLVABLE.search(text)
    if found:
        return NoPlan(PlannerState.UNSOLVABLE, _sentence(found.group(0)))
    if "downward" in name.lower() and returncode in _FAST_DOWNWARD_EXIT:
        state, reason = _FAST_DOWNWARD_EXIT[returncode]
        bad = _BAD_INPUT.search(text) if state == PlannerState.INVALID else None
        return NoPlan(state, f"{reason}: {_sentence(bad.group(0))}" if bad else reason)
    found = _BAD_INPUT.search(text)
    if found:
        where = text[found.end() :].strip().splitlines()
        detail = _sentence(found.group(0))
        # FF names what it stumbled over in the line below.
        if detail.endswith(":") and where:
            detail += " " + where[0].strip()
        return NoPlan(PlannerState.INVALID, detail)
    for pattern, state in (
        (_MEMORY, PlannerState.CRASHED),
        (_TIME, PlannerState.TIMEOUT),
        (_NO_PLAN, PlannerState.NO_PLAN),
    ):
        found = pattern.search(text)
        if found:
            return NoPlan(state, _sentence(found.group(0)))
    return None


def _sentence(line: str) -> str:
    return re.sub(r"^\[t=[^\]]*\]\s*", "", line.strip()).strip(";*").strip()


def _file_order(name: str) -> Tuple[int, str]:
    number = _NUMBERED.search(name)
    return (int(number.group(1)) if number else 0, name)


def _timed_blocks(text: str) -> List[Plan]:
    """Runs of ``<time>: (<action>) [<duration>]`` lines; comments do not interrupt one."""
    blocks: List[Plan] = []
    current: Plan = []
    for line in text.splitlines():
        stripped = line.strip()
        step = None if stripped.startswith(";") else parse_line(line)
        if step is not None:
            current.append(step)
        elif current and (not stripped.startswith(";") or _HEADING.match(stripped)):
            blocks.append(current)
            current = []
    if current:
        blocks.append(current)
    return blocks


def _sequential(pattern: "re.Pattern[str]", lines: Iterable[str]) -> Plan:
    steps: Plan = []
    for line in lines:
        found = pattern.match(line)
        if found:
            words = found.group(1).split()
            steps.append(PlanStep(float(len(steps)), words[0], tuple(words[1:]), NO_DURATION))
    return steps


def _enhsp_plans(output: str) -> List[Plan]:
    """ENHSP's plans, which have no durations."""
    parts = [part.split("Plan-Length", 1)[0].splitlines() for part in _ENHSP_PLAN.split(output)[1:]]
    found = [[match.group(1) for match in map(_ENHSP_STEP.match, lines) if match] for lines in parts]
    return [_sequential(_FILE_STEP, lines) for lines in found]


def _kairos_plans(output: str) -> List[Plan]:
    """kairos' JSON, one line per plan, each better than the one before."""
    plans: List[Plan] = []
    for line in output.splitlines():
        if not line.startswith('{"temporal"'):
            continue
        try:
            steps = json.loads(line)["steps"]
            plans.append(
                [
                    PlanStep(float(step["time"]), words[0], tuple(words[1:]), step["duration"] or NO_DURATION)
                    for step, words in ((step, step["action"].strip("()").split()) for step in steps)
                ]
            )
        except (ValueError, KeyError, IndexError, TypeError):
            continue  # cut off by a time limit; the plans before it are whole
    return plans


def _ff_plans(output: str) -> List[Plan]:
    plans: List[Plan] = []
    for part in _FF_PLAN.split(output)[1:]:
        steps: Plan = []
        for line in part.splitlines()[1:]:
            found = _FF_STEP.match(line)
            if found:
                words = found.group(2).split()
                # Metric-FF closes a plan for a compiled goal with an action of its own.
                if words[0].upper() != "REACH-GOAL":
                    steps.append(PlanStep(float(len(steps)), words[0], tuple(words[1:]), NO_DURATION))
            elif steps:
                break
        plans.append(steps)
    return plans


def _fast_downward_plans(output: str) -> List[Plan]:
    plans: List[Plan] = []
    for part in _FD_PLAN.split(output)[1:]:
        steps: List[str] = []
        for line in part.splitlines()[1:]:
            if _FD_STEP.match(line):
                steps.append(line)
                continue
            # The same heading stands above the statistics of a search that found nothing.
            if "Plan length" in line:
                plans.append(_sequential(_FD_STEP, steps))
            break
    return plans
