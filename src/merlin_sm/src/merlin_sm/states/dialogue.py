# SPDX-License-Identifier: Apache-2.0
"""A question and its answer, asked again when the answer was not understood."""

from typing import Any, Optional, Sequence, cast

from merlin_sm.merlin_sm import MerlinSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED, MerlinState
from merlin_sm.states.speech import MISUNDERSTOOD, ListenState, SpeakState
from merlin_sm.states.text_keys import keys_of

SORRY = "Sorry, I did not understand."


class AskSM(MerlinSM):
    """Says a question, listens, and asks again. ``userdata.heard`` becomes what was understood.

    Outcomes: succeeded, misunderstood (``attempts`` times), aborted, preempted.

    :param question: ``{key}`` is replaced by the userdata of that name.
    :param grammar: JSGF text of the answers.
    :param keys: the userdata keys that the question may name; None: those that it names.
    :param attempts: how often it asks in all.
    :param sorry: said before it asks again.
    :param timeout: s of ROS time to wait for an answer; 0: the listener's default.
    """

    def __init__(
        self,
        question: str,
        grammar: str,
        keys: Optional[Sequence[str]] = None,
        attempts: int = 3,
        sorry: str = SORRY,
        timeout: float = 0.0,
    ) -> None:
        if not isinstance(attempts, int) or attempts < 1:
            raise ValueError(f"attempts is {attempts!r}; it has to be a whole number from 1 on")
        keys = keys_of([question, sorry], keys)
        super().__init__([SUCCEEDED, MISUNDERSTOOD, ABORTED, PREEMPTED], keys, ["heard"])
        self._attempts = attempts
        self._asked = 0
        self.register_start_cb(self._first)
        with self:
            self.add("ASK", SpeakState(question, keys), {SUCCEEDED: "LISTEN"})
            self.add("LISTEN", ListenState(grammar, timeout), {MISUNDERSTOOD: "AGAIN"})
            again = FunctionState(self._again, outcomes=[MISUNDERSTOOD])
            self.add("AGAIN", again, {SUCCEEDED: "ASK_AGAIN"})
            self.add("ASK_AGAIN", SpeakState(f"{sorry} {question}", keys), {SUCCEEDED: "LISTEN"})

    def _first(self, userdata: Any, initial_states: Sequence[str]) -> None:
        self._asked = 1
        userdata.heard = ""  # until something is understood

    def _again(self, userdata: Any) -> Optional[str]:
        if self._asked >= self._attempts:
            again = cast(MerlinState, self["AGAIN"])
            again.reason = f"no answer was understood in {self._attempts} attempts"
            return MISUNDERSTOOD
        self._asked += 1
        return None
