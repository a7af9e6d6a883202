# SPDX-License-Identifier: Apache-2.0
"""What planners print. The samples follow each planner's form; the plans in them are our own."""

import pytest

from merlin_pddl.plan_text import NO_DURATION
from merlin_rosplan.planning.planner_output import candidate_plans, verdict
from merlin_rosplan.planning.planning_outcome import PlannerState

POPF = """\
Number of literals: 6
Constructing lookup tables: [10%] [20%] [100%]
Post filtering unreachable actions:  [100%]
No analytic limits found, not considering limit effects of goal-only operators
Initial heuristic = 4.000
b (3.000 | 25.000)b (1.000 | 30.001);;;; Solution Found
; States evaluated: 9
; Cost: 60.003
; Time 0.01
0.000: (navigate anywhere kitchen)  [25.000]
25.001: (ask kitchen)  [5.000]

 * All goal deadlines now no later than 60.003
Resorting to best-first search
; Plan found with metric 30.001
; States evaluated so far: 31
; States pruned based on pre-heuristic cost lower bound: 0
; Time 0.03
0.000: (navigate anywhere hall)  [5.000]
5.001: (ask hall)  [5.000]
"""

FF = """\

ff: parsing domain file
domain 'HOME' defined
 ... done.
ff: parsing problem file
problem 'TASK' defined
 ... done.


Cueing down from goal distance:    2 into depth [1]
                                   1            [1]
                                   0

ff: found legal plan as follows

step    0: NAVIGATE ANYWHERE KITCHEN
        1: ASK KITCHEN


time spent:    0.00 seconds instantiating 8 easy, 0 hard action templates
               0.00 seconds reachability analysis, yielding 6 facts and 8 actions
"""

METRIC_FF = """\
ff: parsing domain file
domain 'HOME' defined
 ... done.
Cueing down from goal distance:    3 into depth [1]
ff: found legal plan as follows
step    0: NAVIGATE ANYWHERE KITCHEN
        1: ASK KITCHEN
        2: REACH-GOAL
plan cost: 30.000000

time spent:    0.00 seconds instantiating 8 easy, 0 hard action templates
"""

FAST_DOWNWARD = """\
INFO     Running translator.
Parsing: [0.000s CPU, 0.001s wall-clock]
[t=0.002s, 9956 KB] New best heuristic value for ff: 1
[t=0.003s, 9956 KB] Solution found!
[t=0.003s, 9956 KB] Actual search time: 0.000s
navigate anywhere kitchen (25)
ask kitchen (5)
[t=0.003s, 9956 KB] Plan length: 2 step(s).
[t=0.003s, 9956 KB] Plan cost: 30
Solution found.
search exit code: 0
"""

TFD = """\
Found new plan:
0.00100000: (navigate anywhere kitchen) [25.00000000]
25.01100000: (ask kitchen) [5.00000000]
Solution with original makespan 30.012 found (ignoring no-moving-targets-rule).
Rescheduled Plan:
0.00000000: (navigate anywhere kitchen) [25.00000000]
25.00100000: (ask kitchen) [5.00000000]
Solution with makespan 30.001 found.
"""

LPG_SCREEN = """\
 NUMERIC_THREATS_MODE: 0
; Command line: lpg -o domain.pddl -f problem.pddl -n 1
 Parsing domain file:  domain 'HOME' defined ... done.
Solution number: 1
Total time:      0.08
Plan computed:
   Time: (ACTION) [action Duration; action Cost]
 0.0003: (NAVIGATE ANYWHERE KITCHEN) [D:25.0000; C:0.1000]
 25.0005: (ASK KITCHEN) [D:5.0000; C:0.1000]

Solution found.
"""

LPG_FILE = """\
; Version LPG-td-1.4
; Problem problem.pddl
; Time 0.08
; Search time 0.00
; MetricValue 30.00

0.0003:   (NAVIGATE ANYWHERE KITCHEN) [25.0000]
25.0005:   (ASK KITCHEN) [5.0000])
"""

KAIROS_JSON = (
    '{"temporal":true,"cost":60,"makespan":60,"steps":[{"time":0,"duration":60,"action":"(ask hall)"}]}\n'
    '{"temporal":true,"cost":30,"makespan":30,"steps":[{"time":0,"duration":25,'
    '"action":"(navigate anywhere kitchen)"},{"time":25,"duration":5,"action":"(ask kitchen)"}]}\n'
)

KAIROS_TEXT = """\
; cost = 3
(ask hall)
(ask hall)
(ask hall)
; better plan 2
; cost = 2
(navigate anywhere kitchen)
(ask kitchen)
"""

NAVIGATE_ASK = [("navigate", ("anywhere", "kitchen")), ("ask", ("kitchen",))]


def lower(plan):
    return [(s.name.lower(), tuple(a.lower() for a in s.arguments)) for s in plan]


@pytest.mark.parametrize("output", [FF, METRIC_FF, FAST_DOWNWARD, TFD, LPG_SCREEN, KAIROS_JSON, KAIROS_TEXT])
def test_the_plan_on_the_screen_is_found(output):
    assert lower(candidate_plans(output)[0]) == NAVIGATE_ASK


@pytest.mark.parametrize("output", [FF, METRIC_FF, FAST_DOWNWARD])
def test_sequential_plans_count_their_steps(output):
    assert [(s.time, s.duration) for s in candidate_plans(output)[0]] == [
        (0.0, NO_DURATION),
        (1.0, NO_DURATION),
    ]


@pytest.mark.parametrize("output, start", [(TFD, 25.001), (LPG_SCREEN, 25.0005), (KAIROS_JSON, 25.0)])
def test_temporal_plans_keep_their_times(output, start):
    assert [(s.time, s.duration) for s in candidate_plans(output)[0]][1] == (start, 5.0)


def test_the_last_plan_of_popf_is_preferred_and_the_first_one_kept():
    best, first = candidate_plans(POPF)
    assert lower(best) == [("navigate", ("anywhere", "hall")), ("ask", ("hall",))]
    assert lower(first) == NAVIGATE_ASK


def test_a_plan_that_was_cut_off_leaves_the_one_before():
    cut = KAIROS_JSON[:-40]
    assert lower(candidate_plans(cut)[0]) == [("ask", ("hall",))]
    assert len(candidate_plans(POPF[:-5])) == 2


@pytest.mark.parametrize(
    "files",
    [
        [("lpgplan_2.SOL", LPG_FILE), ("lpgplan_1.SOL", LPG_FILE[:-40])],
        [("sas_plan", "(navigate anywhere kitchen)\n(ask kitchen)\n; cost = 30 (general cost)\n")],
        [
            ("sas_plan.2", "(navigate anywhere kitchen)\n(ask kitchen)\n; cost = 2\n"),
            ("sas_plan.1", "(ask hall)\n"),
        ],
        [
            ("tfdplan.10", "0.0: (navigate anywhere kitchen) [25.0]\n25.1: (ask kitchen) [5.0]\n"),
            ("tfdplan.9", "0.0: (ask hall) [5]\n"),
        ],
    ],
)
def test_the_best_plan_file_is_preferred(files):
    assert lower(candidate_plans("", files)[0]) == NAVIGATE_ASK


def test_other_files_are_no_plans():
    assert candidate_plans("", [("stderr.txt", "0.0: (ask hall) [5]\n")]) == []


@pytest.mark.parametrize(
    "output",
    [
        "ff: goal can be simplified to TRUE. The empty plan solves it\n",
        ";;;; Solution Found\n; States evaluated: 0\n; Cost: 0.000\n; Time 0.00\n\n",
        '{"temporal":true,"cost":0,"makespan":0,"steps":[]}\n',
        "[t=0.1s, 9 KB] Actual search time: 0.0s\n[t=0.1s, 9 KB] Plan length: 0\n",
    ],
)
def test_an_empty_plan_is_a_plan(output):
    assert candidate_plans(output) == [[]]


@pytest.mark.parametrize(
    "output",
    [
        "",
        "Segmentation fault\n",
        ";; Problem unsolvable!\n",
        "best first search space empty!\n",
        "[t=0.1s, 9 KB] Actual search time: 0.0s\n[t=0.1s, 9 KB] Expanded 0\n",
    ],
)
def test_nothing_is_no_plan(output):
    assert candidate_plans(output) == []


@pytest.mark.parametrize(
    "output, code, name, state, part",
    [
        (";; Problem unsolvable!\n", 0, "popf", PlannerState.UNSOLVABLE, "unsolvable"),
        (
            "ff: goal can be simplified to FALSE. No plan will solve it\n",
            0,
            "ff",
            PlannerState.UNSOLVABLE,
            "FALSE",
        ),
        (
            "best first search space empty! problem proven unsolvable.\n",
            0,
            "metric-ff",
            PlannerState.UNSOLVABLE,
            "proven",
        ),
        (
            "Completely explored state space -- no solution!\n",
            12,
            "fast-downward",
            PlannerState.NO_PLAN,
            "not a proof",
        ),
        (
            "[t=0.004s, 9 KB] Search terminated -- no plan exists!\n[t=0.1s, 9 KB] Actual search time: 0s\n",
            11,
            "fast-downward.py",
            PlannerState.UNSOLVABLE,
            "Search terminated -- no plan exists!",
        ),
        (
            "The problem is unsolvable since at the fixpoint level the goals are mutex or not reachable\n",
            0,
            "lpg",
            PlannerState.UNSOLVABLE,
            "fixpoint",
        ),
        ("", 11, "fast-downward.py", PlannerState.UNSOLVABLE, "proved"),
        (
            "Error in requirements.\nReason: Invalid requirement. Got: :numeric-fluents\nExpected: :strips\n",
            31,
            "fast-downward.py",
            PlannerState.INVALID,
            "Invalid requirement. Got: :numeric-fluents",
        ),
        ("", 23, "fast-downward", PlannerState.TIMEOUT, "time"),
        ("", 22, "fast-downward", PlannerState.CRASHED, "memory"),
        (
            "\nThe goals of the planning problem can not be reached.\n",
            0,
            "lpg",
            PlannerState.UNSOLVABLE,
            "reached",
        ),
        (
            "ff: parsing domain file\nsyntax error in line 5, 'PREDICATEZ':\n'domain definition' expected\n",
            1,
            "ff",
            PlannerState.INVALID,
            "'domain definition' expected",
        ),
        (
            "domain.pddl: line: 7: Error: Syntax error in domain definition.\n",
            0,
            "popf",
            PlannerState.INVALID,
            "line: 7",
        ),
        ("undeclared predicate CHEKD used in domain definition\n", 1, "ff", PlannerState.INVALID, "CHEKD"),
        (
            "terminate called after throwing an instance of 'std::bad_alloc'\n",
            -6,
            "popf",
            PlannerState.CRASHED,
            "bad_alloc",
        ),
        # POPF and OPTIC: found without a search, by the relaxation; the exit status is 0.
        (
            "Number of literals: 6\nConstructing lookup tables: [100%]\n"
            "The supplied problem has been deemed unsolvable\n",
            0,
            "popf",
            PlannerState.UNSOLVABLE,
            "deemed unsolvable",
        ),
        (
            "Initial heuristic = 3.000\nb (2.000 | 1.0)\nResorting to best-first search\n"
            "Problem Unsolvable\n; Time 0.02\n",
            0,
            "optic-clp",
            PlannerState.UNSOLVABLE,
            "Unsolvable",
        ),
        # Fast Downward: the translator's proof, then the search over its stand-in task, with code 12.
        (
            "Simplified to trivially false goal! Generating unsolvable task...\n"
            "Completely explored state space -- no solution!\n",
            12,
            "fast-downward.py",
            PlannerState.UNSOLVABLE,
            "trivially false goal",
        ),
        (
            "No relaxed solution! Generating unsolvable task...\n",
            12,
            "fast-downward.py",
            PlannerState.UNSOLVABLE,
            "No relaxed solution",
        ),
        ("Search stopped without finding a solution.\n", 12, "downward", PlannerState.NO_PLAN, "not a proof"),
        ("Task is provably unsolvable.\n", 11, "downward", PlannerState.UNSOLVABLE, "provably"),
        ("Time limit has been reached.\n", 23, "downward", PlannerState.TIMEOUT, "time"),
        # Temporal Fast Downward prints its search only.
        (
            "Completely explored state space -- no solution!\nActual search time: 0.1 s.\n",
            0,
            "tfd",
            PlannerState.NO_PLAN,
            "explored",
        ),
        ("No solution found within the time limit\n", 0, "tfd", PlannerState.TIMEOUT, "time limit"),
        # LPG searches locally: what it does not find may exist.
        ("No plan was found within the search limits\n", 0, "lpg-td", PlannerState.NO_PLAN, "No plan was"),
        (
            "Searching:\n...... search limit exceeded. Restart.\n...... search limit exceeded.\n",
            0,
            "lpg",
            PlannerState.NO_PLAN,
            "limit",
        ),
        ("Max time exceeded\n", 0, "lpg", PlannerState.TIMEOUT, "exceeded"),
        # SMTPlan looks at plans of so many happenings.
        ("No plan found in 8 happenings\n", 0, "SMTPlan", PlannerState.NO_PLAN, "8 happenings"),
        # unified-planning's command line prints a status; so Tamer and every other of its engines.
        ("status: UNSOLVABLE_PROVEN\nengine: Tamer\n", 0, "up", PlannerState.UNSOLVABLE, "PROVEN"),
        ("status: UNSOLVABLE_INCOMPLETELY\n", 0, "up", PlannerState.NO_PLAN, "INCOMPLETELY"),
        ("status: TIMEOUT\n", 0, "up", PlannerState.TIMEOUT, "TIMEOUT"),
        ("Problem Detected as Unsolvable\n", 0, "enhsp", PlannerState.UNSOLVABLE, "Unsolvable"),
        ("best first search space empty!\n", 0, "ff", PlannerState.NO_PLAN, "empty"),
    ],
)
def test_why_there_is_no_plan(output, code, name, state, part):
    said = verdict(output, "", code, name)
    assert said.state == state and part in said.reason


def test_a_planner_that_says_nothing_has_no_verdict():
    assert verdict("Number of literals: 6\n", "", 1, "popf") is None


ENHSP = """\
 g(n)= 2.0 h(n)=1.0
Problem Solved

Found Plan:
0.0: (go a b)
1.0: (sweep b)

Plan-Length:2
Metric (Search):2.0
"""


def test_enhsp_prints_no_durations():
    (plan,) = candidate_plans(ENHSP)
    assert [str(step) for step in plan] == ["(go a b)", "(sweep b)"]
    assert all(step.duration == NO_DURATION for step in plan)
