# SPDX-License-Identifier: Apache-2.0
"""Judges a timeline of actions by PDDL 2.1: was every condition true when it had to be?"""

import itertools
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple

from pddl21 import Ground, Model, State, Tree, interfere


class Event(NamedTuple):
    """One moment of a timeline.

    :param time: s.
    :param kind: "start", "end" of an action, or "timed".
    :param action: its number in the plan; for "timed" that in `Model.timed`.
    """

    time: float
    kind: str
    action: int


class Verdict(NamedTuple):
    """What is wrong, "" when nothing is, and the last state."""

    fault: str
    state: State


def judge(
    model: Model, actions: Sequence[Ground], events: Sequence[Event], together: bool = False
) -> Verdict:
    """Plays events in their order; with `together` those of one time see the same state, as in a plan.

    A plain action is one moment: its end. A durative one has its conditions checked at its start, all the
    while and at its end.
    """
    state = model.initial.copy()
    running: List[int] = []
    numbers = itertools.count()
    moments = itertools.groupby(events, key=lambda event: event.time if together else next(numbers))
    for moment in (list(group) for _, group in moments):
        time = moment[0].time
        effects = []
        for event in moment:  # all see the state before
            needs, does = _at(model, actions, event)
            for condition in needs:
                if not model.holds(condition, state):
                    text = f"{event.kind} of {actions[event.action].text}"
                    return Verdict(f"at {time:.3f} {condition} is false: {text}", state)
            effects.append(does)
            if event.kind == "end" and actions[event.action].durative:
                running.remove(event.action)
        for does in effects:
            state = model.apply(does, state)
        running += [e.action for e in moment if e.kind == "start" and actions[e.action].durative]
        for number in running:
            for condition in actions[number].conditions["all"]:
                if not model.holds(condition, state):
                    text = f"at {time:.3f} {condition} is false while {actions[number].text} runs"
                    return Verdict(text, state)
    return Verdict("", state)


def _at(model: Model, actions: Sequence[Ground], event: Event) -> Tuple[List[Tree], List[Tree]]:
    """Conditions and effects of an event."""
    if event.kind == "timed":
        return [], [model.timed[event.action].effect]
    action = actions[event.action]
    if action.durative:
        return action.conditions[event.kind], action.effects[event.kind]
    return ([], []) if event.kind == "start" else (action.conditions["start"], action.effects["start"])


def planned_events(
    model: Model, actions: Sequence[Ground], times: Sequence[Tuple[float, float]]
) -> List[Event]:
    """The timeline of a plan; `times`: start and duration of each action."""
    events = [Event(timed.time, "timed", number) for number, timed in enumerate(model.timed)]
    for number, (action, (start, duration)) in enumerate(zip(actions, times)):
        events.append(Event(start, "start", number))
        events.append(Event(start + (duration if action.durative else 0.0), "end", number))
    return sorted(events, key=lambda event: (event.time, event.kind != "timed"))


def validate(
    model: Model, actions: Sequence[Ground], times: Sequence[Tuple[float, float]], epsilon: float = 0.001
) -> Verdict:
    """Whether a plan is valid: every condition, and no two interfering happenings closer than `epsilon`.

    The goal is not looked at.
    """
    events = planned_events(model, actions, times)
    touched: Dict[int, Optional[Tuple]] = {}
    for number, event in enumerate(events):
        touched[number] = _touched(model, actions, event)
        for other in range(number - 1, -1, -1):
            if event.time - events[other].time >= epsilon - 1e-9:
                break
            one, two = touched[other], touched[number]
            if one is None or two is None or (event.kind != "timed" and events[other].action == event.action):
                continue
            if interfere(one, two):
                return Verdict(f"{events[other]} and {event} interfere", model.initial)
    return judge(model, actions, events, together=True)


def _touched(model: Model, actions: Sequence[Ground], event: Event) -> Optional[Tuple]:
    if event.kind == "timed":
        effect = model.timed[event.action].effect
        return model.touched([], [["assign", *effect[1:]] if effect[0] == "=" else effect])
    needs, does = _at(model, actions, event)
    if event.kind == "end":
        # The standard lets two actions end at one moment of which one breaks what the other needs over all.
        # No execution can promise that.
        needs = needs + actions[event.action].conditions["all"]
    return model.touched(needs, does) if needs or does else None
