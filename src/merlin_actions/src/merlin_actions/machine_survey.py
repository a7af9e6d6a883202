# SPDX-License-Identifier: Apache-2.0
"""What an action's machine needs: userdata, points of interest and action servers."""

from typing import Any, Dict, Iterator, List, Mapping, Sequence, Tuple

import smach
from merlin_actions.core.application_check import ApplicationError, ApplicationWorld, Needs
from merlin_actions.core.robot_parameter import robot_parameter, with_robot
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_pddl.checks.literals import Literal, calls_of, literals_of, renamed
from merlin_ros.class_path import cannot_be_made
from merlin_sm.autonomy import label_text
from merlin_sm.states.action_state import ActionState
from merlin_sm.states.knowledge import KnowledgeState
from merlin_sm.states.navigation import NavigationState
from merlin_sm.states.ros_calls import ServiceCallState
from merlin_sm.userdata_keys import given_keys, remapping_of


def fitted(machine: MerlinActionSM, world: ApplicationWorld) -> MerlinActionSM:
    """The machine for the domain: the same, or one that has the robot too (:meth:`MerlinActionSM.fitted`).

    :raises ApplicationError: when that one cannot be made.
    """
    operator, own = machine.operator_name(), type(machine)
    parameters = world.operators.get(operator, ())
    try:
        robot = robot_parameter(operator, parameters, world.parents, machine.robot_parameter)
    except ValueError:  # the check of the robots says so
        return machine
    variables = [variable for variable, _ in parameters]
    kind = own.fitted(variables, robot, lambda text: with_robot(text, robot, world.facts, world.parents))
    try:
        return machine if kind is own else kind()
    except (Exception, SystemExit) as error:  # users' code
        raise ApplicationError([cannot_be_made(f"{own.__module__}:{own.__name__}", error)]) from error


def survey(machine: MerlinActionSM) -> Needs:
    """Looks at a machine and all nested ones."""
    states = list(_states(machine, (), {}))
    drives = [(state, keys) for _, state, keys in states if isinstance(state, NavigationState)]
    fixed = [state.target for state, _ in drives if isinstance(state.target, str)]
    read = [keys.get("target", "target") for state, keys in drives if state.target is None]
    return Needs(
        type(machine).__name__,
        machine.operator_name(),
        tuple(machine.parameters),
        tuple(dict.fromkeys(key for key in read if key in machine.parameters)),
        tuple(dict.fromkeys(fixed)),
        tuple((path, state.action) for path, state, _ in states if isinstance(state, ActionState)),
        tuple(_unset(machine, ())),
        machine.robot_parameter,
        machine.concurrent,
        (*machine.while_running, *machine.if_interrupted, *machine.if_stopped_at),
        (*_facts(states), *literals_of(type(machine), {"change_facts": -1}, (MerlinActionSM,))),
        calls_of(type(machine), "add_objects", (MerlinActionSM,)),
        tuple(
            (path, s.action, tuple(s.asks)) for path, s, _ in states if isinstance(s, ActionState) and s.asks
        ),
        tuple((path, s.service) for path, s, _ in states if isinstance(s, ServiceCallState)),
    )


def _facts(states: Sequence[Tuple[str, smach.State, Dict[str, str]]]) -> Iterator[Literal]:
    """The facts of states that change knowledge, with the keys of the outermost machine."""
    for path, state, keys in states:
        if isinstance(state, KnowledgeState):
            for fact in state.changes:
                yield Literal(f"state {path}", renamed(fact, keys))


def _states(
    container: Any, path: Sequence[str], names: Mapping[str, str]
) -> Iterator[Tuple[str, smach.State, Dict[str, str]]]:
    """Each innermost state: its path, and its userdata key → key of the outermost machine."""
    for label, child in container.get_children().items():
        here = [*path, label_text(label)]
        own = remapping_of(container, child)
        keys = {key: names.get(own.get(key, key), own.get(key, key)) for key in _keys(child)}
        if isinstance(child, smach.Container):
            yield from _states(child, here, keys)
        else:
            yield "/".join(here), child, keys


def _keys(state: smach.State) -> List[str]:
    return [*state.get_registered_input_keys(), *state.get_registered_output_keys()]


def _unset(container: Any, path: Sequence[str]) -> Iterator[str]:
    """Userdata that states read although nothing sets it."""
    there = {*container.get_registered_input_keys(), *container.userdata.keys(), *given_keys(container)}
    children = container.get_children()
    for child in children.values():
        own = remapping_of(container, child)
        there.update(getattr(child, "constants", ()))
        there.update(own.get(key, key) for key in child.get_registered_output_keys())
    for label, child in children.items():
        here = [*path, label_text(label)]
        own = remapping_of(container, child)
        for key in child.get_registered_input_keys():
            name = own.get(key, key)
            if name not in there:
                has = ", ".join(sorted(map(label_text, there))) or "nothing"
                yield (
                    f"state {'/'.join(here)} reads userdata {label_text(name)!r}, which nothing sets; "
                    f"there is: {has}"
                )
        if isinstance(child, smach.Container):
            yield from _unset(child, here)
