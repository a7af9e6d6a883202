# SPDX-License-Identifier: Apache-2.0
"""MerlinActionBT: the base class of actions that are behaviour trees (py_trees)."""

from typing import Mapping, Optional, Sequence

import py_trees

import smach
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_sm.states.merlin_state import SUCCEEDED
from merlin_sm.trees.behaviour_tree import BehaviourTree
from merlin_sm.trees.state_behaviour import StateBehaviour


class MerlinActionBT(MerlinActionSM):
    """A PDDL action as a behaviour tree. A subclass makes it in :meth:`tree`:

    .. code-block:: python

        class Fetch(MerlinActionBT):
            parameters = ["from", "to"]

            def tree(self):
                there = self.behaviour("DRIVE", self.state("navigation"), remapping={"target": "from"})
                back = self.behaviour("RETURN", self.state("navigation"), remapping={"target": "to"})
                return py_trees.composites.Sequence("FETCH", memory=True, children=[there, back])

    All else is as with :class:`MerlinActionSM`, which it is: a machine whose one state is the tree. The
    parameters are userdata of all its states; SUCCESS of the root is succeeded, FAILURE is aborted.
    """

    period: float = 0.0
    """s of ROS time after which the tree is ticked although nothing has happened; 0: not at all."""

    def build(self) -> None:
        """Adds the tree as the only state."""
        root = self.tree()
        self._tree = BehaviourTree(root, self.parameters, self.period)
        self.add(root.name.replace("/", "_"), self._tree)

    def tree(self) -> py_trees.behaviour.Behaviour:
        """Makes the tree and returns its root."""
        raise NotImplementedError(f"{type(self).__name__} has to implement tree()")

    @staticmethod
    def behaviour(
        name: str,
        state: smach.State,
        success: Sequence[str] = (SUCCEEDED,),
        remapping: Optional[Mapping[str, str]] = None,
    ) -> StateBehaviour:
        """Makes a behaviour of a state.

        :param state: any; :meth:`state` makes the ready ones.
        :param success: its outcomes that are SUCCESS; all others are FAILURE.
        :param remapping: userdata key of the state → userdata key of the action.
        """
        return StateBehaviour(name, state, success, remapping)

    def wake(self) -> None:
        """Requests a tick: for behaviours that depend on changes outside of the tree, from any thread."""
        self._tree.wake()
