# SPDX-License-Identifier: Apache-2.0
"""The verdict on a stop: what has not ended, whether the base stands, what the guard did. Pure."""

from typing import NamedTuple, Sequence

from merlin_executor.core.outcome import Outcome, Verdict

#: Longest wait for the base to stand after everything has ended, s of running time.
STAND_WAIT = 0.5
MOVES = "the base still moves"


class Halt(NamedTuple):
    """The result of a request to the guard to halt the base."""

    guard: bool
    """Whether there is a guard that could halt the base."""
    halted: bool = False
    """The guard has halted the base."""
    message: str = ""
    """Its own words, or why it did not answer."""

    @property
    def words(self) -> str:
        """The text as part of a sentence."""
        if not self.guard:
            return "no guard runs that could halt the base"
        if self.halted:
            return "the guard has halted the base"
        return f"the guard could not halt the base: {self.message or 'it gave no reason'}"


def together(halts: Sequence[Halt]) -> Halt:
    """The result for several bases: all of those that have a guard have to stand."""
    guarded = [halt for halt in halts if halt.guard]
    if not guarded:
        return halts[0]
    return next((halt for halt in guarded if not halt.halted), guarded[0])


def unstopped(names: Sequence[str], halt: Halt, reason: str = "", held_up_by: str = "") -> Verdict:
    """The verdict on a run of which something did not stop.

    :param names: what did not stop, as PDDL text.
    :param reason: a sentence that says so already, or why it had to stop; empty: its client wanted it to.
    :param held_up_by: a sentence that names what did not stop below them, such as a server; empty: not known.
    """
    text = f"{', '.join(names)} did not stop"
    if reason:
        text = reason if "did not" in reason else f"{reason}; {text}"
    if held_up_by:
        text += f": {held_up_by}"
    return Verdict(Outcome.CANCEL_TIMEOUT, f"{text}; {halt.words}", ", ".join(names))


def still_moving(verdict: Verdict, halt: Halt) -> Verdict:
    """The verdict on a run that has ended while the base still moves.

    A cancel is not complete before the base stands; a failure stays the failure that it was.
    """
    if verdict.outcome is Outcome.CANCELLED:
        return Verdict(Outcome.CANCEL_TIMEOUT, f"{MOVES} although all actions have ended; {halt.words}")
    return verdict._replace(reason=f"{verdict.reason}; {MOVES}, {halt.words}")
