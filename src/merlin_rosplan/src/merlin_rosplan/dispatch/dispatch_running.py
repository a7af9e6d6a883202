# SPDX-License-Identifier: Apache-2.0
"""An action that was dispatched and has not ended: what is known of it, and what is watched."""

import math
from typing import Any, FrozenSet, Iterator, NamedTuple, Optional, Sequence, Tuple

from merlin_pddl.plan_text import INTERFACE_GONE
from merlin_rosplan.dispatch.dispatch_environment import DispatchEnvironment, DispatchLimits
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatch.operator_model import (
    ActionModel,
    Conditions,
    broken_by_own_end,
    over_all_before_start,
)


class Fault(NamedTuple):
    """Why a running action is given up; `gone`: no node would answer a cancel."""

    reason: str
    gone: bool = False


class Running:
    """One running action, from when it was sent.

    :param operator: its ground model.
    """

    def __init__(
        self,
        action: PlannedAction,
        operator: ActionModel,
        environment: DispatchEnvironment,
        limits: DispatchLimits,
    ) -> None:
        self.action, self.operator = action, operator
        self.acknowledge = environment.deadline(limits.acknowledge)
        self.accept = environment.deadline(limits.accept)
        self.settle = environment.deadline(limits.settle)
        self.watched = over_all_before_start(operator)  # over-all conditions that hold and have to stay true
        self.pending = operator.over_all - self.watched  # its start effects bring them about: then watched
        self.names = operator.over_all.names
        self.ends = environment.now() + action.duration  # as planned, s of ROS time
        self.taken = False
        self.alive: Optional[Any] = None  # until then its interface is alive, having taken the action
        self.unannounced = math.inf  # s without an announcement when an interface took it that makes none
        self.applied: Optional[Any] = None  # until then its start effects are applied, if it was taken
        self.closed: Optional[Any] = None  # until then the node that took it may end it over a new connection
        self.sent_again = False
        self.grace: Optional[Any] = None
        self.broken = ""
        # names its start effects change, no change of them seen
        self.unheard = set(operator.start_effects.names) if operator.durative else set()
        self.leaving: Optional[Any] = None  # until then it has to have stopped: another plan does without it
        self.look = True  # whether it is worth asking again for its start effects

    @property
    def seen_at_once(self) -> bool:
        """Whether its start changes nothing that would have to be applied first."""
        return not self.operator.durative or self.operator.start_effects.empty

    def brings(self, unmet: Conditions) -> bool:
        """Whether it is a plain action that changes what these conditions depend on, until it ends."""
        return not self.operator.durative and bool(self.operator.start_effects.names & unmet.names)

    def changed(self, names: Optional[FrozenSet[str]]) -> None:
        """These predicates and functions have changed; None: any may have."""
        if names is None:
            self.unheard.clear()
            self.look = True
        else:
            self.unheard -= names
            self.look |= not names or bool(names & self.operator.start_effects.names)

    def start_applied(self, environment: DispatchEnvironment) -> bool:
        """Whether the start effects are applied.

        A knowledge base of ours lists the executions, and nothing else counts: a change may be of another
        action. Of others a change of what they change can be seen: where none comes, because the effect
        changes nothing, the time an interface has to apply them must do.
        """
        if self.applied is not None and self.applied.remaining() <= 0:
            return True
        if not self.look:
            return False
        self.look = False
        begun = environment.begun(self.action)
        if begun is not None:
            return begun
        if self.unheard:
            return False
        added = {atom.key for atom in self.operator.start_effects.add}
        deleted = tuple(atom for atom in self.operator.start_effects.delete if atom.key not in added)
        wanted = Conditions(self.operator.start_effects.add, deleted)
        return wanted.empty or environment.false_of(self.action, wanted).empty

    def is_affected(self, changes: Optional[FrozenSet[str]]) -> bool:
        """Whether its over-all conditions depend on what has changed; None: anything may have."""
        return bool(self.names) and self.leaving is None and (changes is None or bool(self.names & changes))

    def fault(self, environment: DispatchEnvironment, limits: DispatchLimits) -> Optional[Fault]:
        """Why it has to be given up, if it has to."""
        action = self.action
        if self.leaving is not None and self.leaving.remaining() <= 0:
            return Fault(f"{action} was cancelled and did not stop within {limits.cancel:g} s")
        silence = self.silence(environment)
        unanswered = self._unanswered()
        dead = self.is_dead(silence, limits.liveness)
        if self.grace is not None and self.grace.remaining() <= 0:
            return Fault(f"{action} cannot continue: {self.broken}")
        if unanswered and silence is None:
            return Fault(f"no action interface for {action.name}", gone=True)
        if dead and (self.taken or unanswered):
            return Fault(f"the action interface of {action.name} {INTERFACE_GONE}{silence:.1f} s", gone=True)
        if silence is None and self._has_left(environment, limits.liveness):
            silent = f"{INTERFACE_GONE}{limits.liveness:g} s"
            return Fault(f"the action interface of {action.name} {silent}", gone=True)
        if not self.taken and self.accept.remaining() <= 0:
            return Fault(
                f"the action interface of {action.name} is alive but did not take {action} "
                f"within {limits.accept:g} s"
            )
        return None

    def patience(self) -> float:
        """Seconds until it may have to be given up."""
        patience = 1.0  # its interface may die without an answer
        if not self.taken:
            first = self.acknowledge.remaining()
            patience = min(first if first > 0 else self.accept.remaining(), 1.0)
        return min([patience, *(each.remaining() for each in (self.grace, self.leaving) if each is not None)])

    def asks_again(self) -> bool:
        """Whether it may have to be sent once more; true once."""
        again = self._unanswered() and not self.sent_again and self.leaving is None
        self.sent_again |= again
        return again

    def _unanswered(self) -> bool:
        return not self.taken and self.acknowledge.remaining() <= 0

    def breaks_itself(self, broken: Conditions) -> bool:
        """Whether its own end effects explain all of these over-all conditions."""
        own = self.operator.end_effects
        return (
            all(broken_by_own_end(self.operator, atom, False) for atom in broken.positive)
            and all(broken_by_own_end(self.operator, atom, True) for atom in broken.negative)
            and all(entry.functions & own.names for entry in broken.comparisons)
            and all(entry.reads & own.names for entry in broken.expressions)
        )

    @property
    def needed_at_end(self) -> Conditions:
        """The at-end conditions that its own end effects leave alone: they can be asked for after the end."""
        own = self.operator.end_effects.names
        needed = self.operator.at_end
        return Conditions(
            tuple(atom for atom in needed.positive if atom.name.lower() not in own),
            tuple(atom for atom in needed.negative if atom.name.lower() not in own),
            tuple(entry for entry in needed.comparisons if not entry.functions & own),
            tuple(entry for entry in needed.expressions if not entry.reads & own),
        )

    def _has_left(self, environment: DispatchEnvironment, patience: Optional[float]) -> bool:
        """Whether the node that took it has been away for so long; it need not have announced itself."""
        if patience is None or not self.taken or not environment.has_left(self.action):
            self.closed = None
        elif self.closed is None:
            self.closed = environment.deadline(patience)
        return self.closed is not None and bool(self.closed.remaining() <= 0)

    def take(self, environment: DispatchEnvironment, liveness: Optional[float]) -> None:
        """An interface has taken it, which is another one than what was announced last, a long time ago."""
        silence = environment.seconds_silent(self.action.name)
        if not self.taken and silence is not None and liveness is not None and silence > liveness:
            self.unannounced = silence
        self.taken = True
        self.alive = environment.deadline(liveness)

    def silence(self, environment: DispatchEnvironment) -> Optional[float]:
        """Seconds since its interface announced itself; None: it did not."""
        silence = environment.seconds_silent(self.action.name)
        return None if silence is not None and silence >= self.unannounced else silence

    def is_dead(self, silence: Optional[float], liveness: Optional[float]) -> bool:
        """Whether its interface announced itself and has stopped; taking an action is a sign of life too."""
        if silence is None or liveness is None or silence <= liveness:
            return False
        return self.alive is None or self.alive.remaining() <= 0


def broken_over_all(
    records: Sequence[Running], environment: DispatchEnvironment, limits: DispatchLimits
) -> Iterator[Tuple[Running, str]]:
    """Asks for the over-all conditions of running actions, in one call; gives those that cannot continue."""
    asked = [(record.action, record.pending + record.watched) for record in records]
    for record, false in zip(records, environment.false_of_each(asked) if asked else []):
        record.watched += record.pending - false  # what has come true has to stay so
        record.pending -= record.watched
        broken = false - record.pending
        if broken.empty:
            record.grace = None
            continue
        record.broken = broken.as_false()
        if not record.breaks_itself(broken):
            yield record, f"{record.action} cannot continue: {record.broken}"
        elif record.grace is None:
            # Interfaces apply the end effects before they report the end.
            record.grace = environment.deadline(limits.over_all_grace)
