# SPDX-License-Identifier: Apache-2.0
"""MerlinActionSM: the base class of MERLIN's actions, each a state machine (paper, section 3.2.3)."""

from typing import Any, Callable, Dict, List, Optional, Sequence, Set, Type

import smach
from merlin_actions.core.names import DECLARED, IF_STOPPED_AT, snake_case
from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.state_factory import MerlinStateFactory
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED
from merlin_sm.userdata_keys import check_lists


class MerlinActionSM(MerlinSM):
    """A PDDL action as a state machine. A subclass adds its states in :meth:`build`:

    .. code-block:: python

        class Navigate(MerlinActionSM):
            parameters = ["from", "to"]
            if_interrupted = ["(robot_at anywhere)"]

            def build(self):
                self.add("DRIVE", self.state("navigation"), remapping={"target": "to"})

    The parameters of the action are userdata of the machine. Its outcomes are succeeded, aborted, preempted
    and :attr:`outcomes`. The node that runs it does the rest: the action server ``actions/<name>``,
    preemption, feedback, introspection.
    """

    operator = ""
    """Name of the PDDL operator; the class name in snake case when empty."""

    parameters: Sequence[str] = ()
    """Its variables without ``?``, compared with the domain at start. An operator that has the robot as well
    needs no other class, see :meth:`fitted`."""

    optional: Sequence[str] = ()
    """Variables that only the operator of some domains has; ``"t" in self.parameters`` says whether."""

    outcomes: Sequence[str] = ()
    """Outcomes besides succeeded, aborted and preempted; they count as failures."""

    while_running: Sequence[str] = ()
    """PDDL literals that hold while the action runs, with the action's ``?variables``."""

    if_interrupted: Sequence[str] = ()
    """PDDL literals that hold after it was stopped or failed, with the action's ``?variables``. When empty,
    the start effects are undone. Numeric effects may stand here too: ``(decrease (battery) (* 0.1 #t))`` with
    the seconds that have passed, ``#t``, and the planned ones, ``?duration``."""

    if_stopped_at: Sequence[str] = ()
    """PDDL literals that hold besides :attr:`if_interrupted` where one of several robots stands at a point of
    interest when it was stopped; ``?here`` is that point. They count together, and only where each changes
    something: ``(not (free ?here))`` keeps a place that another robot holds with that one."""

    safe_to_interrupt: Optional[Sequence[str]] = None
    """Names of the states at which a more urgent request may interrupt it; it waits for them, or for the end.
    A container counts with all that is in it; what is inside a child of a Concurrence cannot be named. None:
    all states; ``()``: none. A cancel by its own client, its deadline and a stop do not wait."""

    robot_parameter = ""
    """With several robots: the parameter that names the one on which it runs. Empty: the one of type
    ``robot``, which is set here before :meth:`build`, where there is one (docs/several-robots.md)."""

    concurrent = 1
    """How many of it may run at once, each in a machine of its own. Their states share one set of servers."""

    def __init__(self) -> None:
        lists = ("parameters", "optional", "outcomes", "safe_to_interrupt", *DECLARED)
        check_lists(**{name: getattr(self, name) for name in lists})
        if not isinstance(self.concurrent, int) or self.concurrent < 1:
            raise ValueError(f"concurrent has to be a whole number from 1 on, not {self.concurrent!r}")
        super().__init__([SUCCEEDED, ABORTED, PREEMPTED, *self.outcomes], input_keys=list(self.parameters))
        with self:
            self.build()
        unknown = set(self.safe_to_interrupt or ()) - _check(self)
        if unknown:
            raise ValueError(
                f"safe_to_interrupt names {', '.join(sorted(unknown))}, which the machine does not have, or "
                "has in a child of a Concurrence (or while), where no state is reported: name the Concurrence"
            )

    def build(self) -> None:
        """Adds the states; the machine is open for construction."""
        raise NotImplementedError(f"{type(self).__name__} has to implement build()")

    @classmethod
    def operator_name(cls) -> str:
        """The PDDL operator that this machine runs."""
        return cls.operator or snake_case(cls.__name__)

    @classmethod
    def fitted(
        cls, variables: Sequence[str], robot: str = "", declare: Callable[[str], str] = lambda text: text
    ) -> Type["MerlinActionSM"]:
        """The class for an operator: this one, or one that has the robot and :attr:`optional` variables too.

        :param variables: of the operator, without ``?``.
        :param robot: the one that names the robot; empty: there is one robot.
        :param declare: makes of a declared literal what it is with several robots.
        """
        own = [name for name in variables if name not in (robot, *cls.optional) or name in cls.parameters]
        if own != list(cls.parameters) or not (robot or cls.if_stopped_at or len(own) < len(variables)):
            return cls
        fits = {"parameters": list(variables)}
        if robot:
            fits.update((key, [declare(text) for text in getattr(cls, key)]) for key in DECLARED)
        else:
            fits[IF_STOPPED_AT] = []
        same = {key: getattr(cls, key) for key in ("__module__", "__qualname__", "__doc__")}
        return type(cls.__name__, (cls,), {**same, **fits, "robot_parameter": robot})

    def keeps(self, path: Sequence[Any]) -> bool:
        """Whether a more urgent request has to wait at a state.

        :param path: its label, behind those of the containers that it is in.
        """
        return self.safe_to_interrupt is not None and not set(path) & set(self.safe_to_interrupt)

    @staticmethod
    def state(name: str, *args: Any, **options: Any) -> smach.State:
        """Makes a ready or registered state: :meth:`MerlinStateFactory.create`."""
        return MerlinStateFactory.create(name, *args, **options)

    def run_once(self, parameters: Dict[str, str]) -> str:
        """Runs the machine to its end.

        :param parameters: variable → object.
        :return: its outcome.
        """
        userdata = smach.UserData()
        for name in self.parameters:
            userdata[name] = parameters[name]
        return str(self.execute(userdata))

    def check_signature(self, variables: List[str]) -> None:
        """Compares the declared parameters with those of the domain.

        :raises ValueError: when they differ.
        """
        if list(self.parameters) != variables:
            raise ValueError(
                f"{type(self).__name__} declares the parameters {list(self.parameters)}, but operator "
                f"{self.operator_name()} of the domain has {variables}"
            )


def _check(container: Any) -> Set[Any]:
    """Checks a container and all in it: SMACH itself only logs what is wrong with them.

    :return: the labels of all that is in it and reported as the present state.
    :raises smach.SmachError: one of them is not complete or contradicts itself.
    """
    container.check_consistency()
    children = container.get_children()
    inner = [_check(child) for child in children.values() if isinstance(child, smach.Container)]
    return set(children) if isinstance(container, smach.Concurrence) else set(children).union(*inner)
