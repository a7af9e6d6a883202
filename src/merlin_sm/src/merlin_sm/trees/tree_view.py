# SPDX-License-Identifier: Apache-2.0
"""A behaviour tree as containers, for everything that looks at machines: viewers, the page, the check."""

from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

import py_trees
from py_trees.common import Status

import smach
from merlin_sm.states.merlin_state import PREEMPTED
from merlin_sm.trees.state_behaviour import StateBehaviour

SUCCESS = Status.SUCCESS.name.lower()
FAILURE = Status.FAILURE.name.lower()
INVALID = Status.INVALID.name.lower()

Behaviour = py_trees.behaviour.Behaviour
Edge = Tuple[str, str, Optional[str]]


class BehaviourView(smach.State):
    """A behaviour that is not a state, as a state that only its tree runs."""

    def __init__(self) -> None:
        super().__init__([SUCCESS, FAILURE])


class Branch(smach.Container):
    """A composite or a decorator: its children, which of them run, and how one leads to another.

    :param node: the composite or the decorator.
    :param available: userdata keys that something of the tree, or its action, sets.
    :param ends: outcomes for SUCCESS and FAILURE; further ones follow.
    """

    def __init__(
        self, node: Behaviour, available: Sequence[str], ends: Sequence[str] = (SUCCESS, FAILURE, INVALID)
    ) -> None:
        leaves = [leaf for leaf in node.iterate() if isinstance(leaf, StateBehaviour)]
        sets = list(dict.fromkeys(key for leaf in leaves for key in leaf.sets))
        super().__init__(list(ends), list(available), sets)
        self.node = node
        self._ends = ends
        self._nodes = _labelled(node.children or [node])
        everything = list(dict.fromkeys([*available, *sets]))
        self._children = {label: _shown(child, everything) for label, child in self._nodes.items()}
        self._active: List[str] = []

    # --- what SMACH asks a container ---------------------------------------------------------------------

    def get_children(self) -> Dict[str, smach.State]:
        """States, and branches, by label."""
        return self._children

    def __getitem__(self, key: str) -> smach.State:
        return self._children[key]

    def get_initial_states(self) -> List[str]:
        """What a run begins with."""
        return list(self._nodes)[: 1 if self._in_turn() else None]

    def set_initial_state(self, initial_states: Sequence[str], userdata: Any = None) -> None:
        """Takes the userdata; where a tree begins is not for a viewer to choose."""
        if userdata is not None:
            self.userdata.update(userdata)

    def get_active_states(self) -> List[str]:
        """Labels of the children that are RUNNING, or in which something still stops."""
        return [label for label, child in self._nodes.items() if _acts(child)]

    def get_internal_edges(self) -> List[Edge]:
        """In a sequence success leads to the next child, in a selector failure does; else the branch ends."""
        succeeded, failed = self._ends[0], self._ends[1]
        labels = list(self._nodes)
        following: List[Optional[str]] = [*labels[1:], None]
        sequence = isinstance(self.node, py_trees.composites.Sequence)
        selector = isinstance(self.node, py_trees.composites.Selector)
        edges: List[Edge] = []
        for label, after in zip(labels, following):
            for outcome, success in _ends(self._nodes[label]).items():
                on = sequence if success else selector
                edges.append((outcome, label, after if on and after else succeeded if success else failed))
        return edges

    def check_consistency(self) -> None:
        """A tree is consistent by its construction."""

    def execute(self, parent_ud: Any = None) -> str:
        """Not for SMACH: the tree ticks it."""
        raise NotImplementedError("a branch is run by its tree")

    def _in_turn(self) -> bool:
        return isinstance(self.node, (py_trees.composites.Sequence, py_trees.composites.Selector))

    # --- what the tree shows -----------------------------------------------------------------------------

    def branches(self) -> Iterator["Branch"]:
        """The branches in it."""
        for child in self._children.values():
            if isinstance(child, Branch):
                yield child

    def share(self, userdata: smach.UserData) -> None:
        """Shows the userdata of a run."""
        self.userdata = userdata
        for branch in self.branches():
            branch.share(userdata)

    def refresh(self) -> None:
        """Reports what has changed since the last call, of all of it."""
        before, self._active = self._active, self.get_active_states()
        if before != self._active:
            self._report(before)
        for branch in self.branches():
            branch.refresh()

    def _report(self, before: List[str]) -> None:
        if not before:
            self.call_start_cbs()
        elif self._active:
            self.call_transition_cbs()
        else:
            self.call_termination_cbs(before, self.node.status.name.lower())


def _shown(node: Behaviour, available: Sequence[str]) -> smach.State:
    if isinstance(node, StateBehaviour):
        return node.state
    return Branch(node, available) if node.children else BehaviourView()


def _ends(node: Behaviour) -> Dict[str, bool]:
    """The outcomes of what is shown for a behaviour, and which of them are SUCCESS."""
    if not isinstance(node, StateBehaviour):
        return {SUCCESS: True, FAILURE: False}
    outcomes = node.state.get_registered_outcomes()
    # A preempt is an interruption by the tree: it leads nowhere in it.
    return {outcome: outcome in node.success for outcome in outcomes if outcome != PREEMPTED}


def _acts(node: Behaviour) -> bool:
    return node.status == Status.RUNNING or any(
        leaf.acts for leaf in node.iterate() if isinstance(leaf, StateBehaviour)
    )


def _labelled(nodes: Sequence[Behaviour]) -> Dict[str, Behaviour]:
    """Behaviours by label: their names, numbered where two are equal; a slash would part a path."""
    labelled: Dict[str, Behaviour] = {}
    for node in nodes:
        label = name = node.name.replace("/", "_") or type(node).__name__
        number = 1
        while label in labelled:
            number += 1
            label = f"{name} {number}"
        labelled[label] = node
    return labelled
