# SPDX-License-Identifier: Apache-2.0
"""Writes docs/states.md, the reference of the ready states, from their classes.

Usage: state_reference.py [--check]     --check only tells whether the page is up to date
Each line under "as written" is made into a state: what it reads, sets and returns is what SMACH knows of it.
"""

import inspect
import re
import sys
from pathlib import Path
from typing import Any, Dict, Iterator, List, NamedTuple, Tuple

from merlin_msgs.msg import ListenAction, ListenGoal
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from merlin_sm.state_factory import MerlinStateFactory

PAGE = Path(__file__).resolve().parent.parent / "docs" / "states.md"
HEAD = """# Ready states

What `self.state("…")` makes in an action, and `MerlinStateFactory.create("…")` in any machine. This page is
made by `tools/state_reference.py` from the classes.

All states have the outcomes `succeeded`, `aborted` and `preempted`. After an abort, the state's `reason`
says why; a preempt ends the state at once. Text in braces, `"Hello {name}"`, names userdata. A machine maps
userdata by `remapping={key of the state: key of the machine}`. `rosrun merlin check` finds userdata that
nothing sets. `GivenUp` is in `merlin_sm.states.merlin_state`. An operator can hold a machine before any
state: [breakpoints](../src/merlin_monitor#breakpoints), or leave a state with one of its outcomes.
`self.add(…, autonomy={"succeeded": "high"})` has an outcome wait for an operator below that
[level](../src/merlin_monitor#forced-outcomes-and-autonomy-levels).
"""
TAIL = """
## Your own

A class on [MerlinState](../src/merlin_sm/src/merlin_sm/states/merlin_state.py) needs `run(userdata)`. It
returns an outcome, or `self.fail("why")`, or `self.give_up("why")` when another try cannot help. What it
waits for it announces with `self.interruptible(wake)`. `MerlinStateFactory.register("name", TheClass)` gives
it a name. States and containers of SMACH itself may be added, too: `smach.Concurrence` runs several at once.
"""
#: The package whose states these are.
OWN = "merlin_sm."
#: Group → states.
GROUPS: Tuple[Tuple[str, Tuple[str, ...]], ...] = (
    ("Drive, speak, hear, see", ("navigation", "speak", "listen", "ask", "recognize")),
    ("Handle objects", ("detect", "pick", "place", "open", "close")),
    ("Decide, remember, wait", ("function", "knowledge", "wait", "while")),
    ("Anything of ROS", ("action", "service", "topic")),
    ("The planning system", ("generate_problem", "plan", "parse_plan", "dispatch_plan")),
)
#: State → how it is written, most usual first.
WRITTEN: Dict[str, Tuple[str, ...]] = {
    "navigation": ('state("navigation")', 'state("navigation", "kitchen")'),
    "speak": ('state("speak")', 'state("speak", "Hello {name}.")'),
    "listen": ('state("listen", GRAMMAR, timeout=10.0)',),
    "ask": ('state("ask", "Is this {order} right?", GRAMMAR)',),
    "recognize": ('state("recognize", ["cup", "person"], least_score=0.5)',),
    "detect": ('state("detect", "{o}", "{s}")',),
    "pick": ('state("pick", "{o}", "{s}")', 'state("pick", "{o}", seen="detections")'),
    "place": ('state("place", "{o}", "{s}")',),
    "open": ('state("open", "fridge")',),
    "close": ('state("close", "{s}")',),
    "function": ('state("function", decide)', 'state("function", decide, ["heard"], ["order"], ["refused"])'),
    "knowledge": ('state("knowledge", add=["(at {o} {p})"], remove=["(held {o})"])',),
    "wait": ('state("wait", 2.0)',),
    "while": ('state("while", state("navigation"), state("topic", "stop", Bool), seen="stopped")',),
    "action": ('state("action", "listen", ListenAction, ListenGoal())',),
    "service": ('state("service", "open_gripper", Trigger, timeout=5.0)',),
    "topic": ('state("topic", "door_open", Bool, lambda userdata, door: door.data)',),
    "generate_problem": ('state("generate_problem", client)',),
    "plan": ('state("plan", client)',),
    "parse_plan": ('state("parse_plan", client)',),
    "dispatch_plan": ('state("dispatch_plan", client)',),
}
GIVEN: Dict[str, Any] = {
    "state": MerlinStateFactory.create,
    "GRAMMAR": "#JSGF V1.0; grammar answer; public <answer> = yes | no;",
    "Bool": Bool,
    "ListenAction": ListenAction,
    "ListenGoal": ListenGoal,
    "Trigger": Trigger,
    "decide": lambda userdata: None,
    "client": object(),  # a real one would look for its master
}


class Doc(NamedTuple):
    """A docstring with Sphinx fields."""

    text: str
    parameters: Dict[str, str]


def read_doc(docstring: str) -> Doc:
    """Takes a docstring apart; its markup becomes that of the page."""
    text, *fields = re.split(r"\n(?=:)", inspect.cleandoc(docstring))
    parameters = {}
    for field in fields:
        match = re.match(r":param (\w+): (.*)", field, re.DOTALL)
        if match:
            parameters[match[1]] = markdown(" ".join(match[2].split()))
    return Doc(markdown(text.strip()), parameters)


def markdown(text: str) -> str:
    """Roles and literals of reStructuredText as Markdown."""
    text = re.sub(r":\w+:`(?:[\w.]*\.)?(\w+)`", r"`\1`", text)
    return text.replace("``", "`")


def arguments(maker: Any) -> Iterator[Tuple[str, str]]:
    """Each argument of a class and its default; of ``**options`` the name only."""
    for parameter in list(inspect.signature(maker.__init__).parameters.values())[1:]:
        if parameter.kind is parameter.VAR_KEYWORD:
            yield f"**{parameter.name}", ""
        elif parameter.default is parameter.empty:
            yield parameter.name, "required"
        elif callable(parameter.default):
            yield parameter.name, "optional"
        else:
            yield parameter.name, f"`{parameter.default!r}`"


def table(head: List[str], rows: List[List[str]]) -> List[str]:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]


def keys(names: Any) -> str:
    """Names as a cell."""
    return ", ".join(f"`{name}`" for name in sorted(names)) or "–"


def section(name: str) -> List[str]:
    """One state's part of the page.

    :raises ValueError: when an argument has no sentence in the docstring.
    """
    maker: Any = MerlinStateFactory.maker(name)
    doc = read_doc(maker.__doc__)
    for base in maker.__mro__[1:]:  # which describes what its states have in common
        doc = doc._replace(parameters={**read_doc(base.__doc__ or "").parameters, **doc.parameters})
    lines = [f"### {name}", "", doc.text, ""]
    rows = []
    for argument, default in arguments(maker):
        if argument.startswith("**"):
            rows.append(
                [f"`{argument}`", "", "`server_wait`, `cancel_limit` and others of [action](#action)"]
            )
        elif argument in doc.parameters:
            rows.append([f"`{argument}`", default, doc.parameters[argument]])
        else:
            raise ValueError(f"{maker.__name__}: the docstring says nothing about the argument {argument!r}")
    if rows:
        lines += [*table(["argument", "default", ""], rows), ""]
    rows = []
    for written in WRITTEN[name]:
        state = eval(written, dict(GIVEN))
        own = [o for o in state.get_registered_outcomes() if o not in ("succeeded", "aborted", "preempted")]
        rows.append(
            [
                f"`{written}`",
                keys(state.get_registered_input_keys()),
                keys(state.get_registered_output_keys()),
                keys(own),
            ]
        )
    return [*lines, *table(["as written", "reads", "sets", "further outcomes"], rows), ""]


def page() -> str:
    """The whole page.

    :raises ValueError: when a registered state is missing here, or one of its arguments is not described.
    """
    named = [name for _, names in GROUPS for name in names]
    # Other packages register theirs when they are imported, as tests do.
    own = [n for n in MerlinStateFactory.names() if MerlinStateFactory.maker(n).__module__.startswith(OWN)]
    missing = set(own) ^ set(named)
    if missing:
        raise ValueError(f"GROUPS and the state factory differ: {', '.join(sorted(missing))}")
    lines = [HEAD]
    for group, names in GROUPS:
        lines += [f"## {group}", ""]
        for name in names:
            lines += section(name)
    return "\n".join(lines).rstrip() + "\n" + TAIL


def main() -> int:
    """Writes the page, or checks whether it is up to date."""
    text = page()
    if sys.argv[1:] == ["--check"]:
        if PAGE.read_text(encoding="utf-8") == text:
            return 0
        print(f"{PAGE.name} is out of date; run: tools/in_workspace.sh python tools/state_reference.py")
        return 1
    PAGE.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
