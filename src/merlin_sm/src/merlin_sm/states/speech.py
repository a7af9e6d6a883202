# SPDX-License-Identifier: Apache-2.0
"""Speech out and in: sound_play and the listen action."""

import string
from typing import Any, Optional, Sequence

import rospy
from merlin_msgs.msg import ListenAction, ListenGoal
from sound_play.msg import SoundRequest, SoundRequestAction, SoundRequestGoal

from merlin_sm.states.action_state import ActionState
from merlin_sm.states.jsgf import check_grammar
from merlin_sm.states.ros_calls import check_shares, check_times
from merlin_sm.states.text_keys import filled, keys_of

MISUNDERSTOOD = "misunderstood"


class _Spoken(string.Formatter):
    """Writes values as they are spoken."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """Of a name its words."""
        return str(super().format_field(value, format_spec)).replace("_", " ")


class SpeakState(ActionState):
    """Says ``userdata.text``, or a fixed text, and ends when it has been said.

    :param text: fixed text; ``{key}`` is replaced by the userdata of that name, in which underscores are
        spoken as blanks: PDDL's ``table_4`` is ``table 4``.
    :param keys: the userdata keys that a fixed text may name; None: those that it names.
    :param voice: of the synthesis, empty: its default.
    :param volume: 0..1.
    :param action: name of the sound_play action.
    """

    def __init__(
        self,
        text: Optional[str] = None,
        keys: Optional[Sequence[str]] = None,
        voice: str = "",
        volume: float = 1.0,
        action: str = "sound_play",
        **options: Any,
    ) -> None:
        check_shares(volume=volume)
        fixed, form = ("{text}", None) if text is None else (text, _Spoken())
        inputs = keys_of([fixed], None if text is None else keys)

        def goal(userdata: Any) -> SoundRequestGoal:
            said = filled(fixed, userdata, form)
            if not said.strip():
                raise ValueError("there is no text to say")
            request = SoundRequest(
                sound=SoundRequest.SAY,
                command=SoundRequest.PLAY_ONCE,
                arg=said,
                arg2=voice,
                volume=volume,
            )
            return SoundRequestGoal(sound_request=request)

        super().__init__(action, SoundRequestAction, goal, input_keys=inputs, **options)


class ListenState(ActionState):
    """Listens for what a grammar allows, and puts it into ``userdata.heard``.

    The outcome misunderstood means that nothing that fits was heard in time.

    :param grammar: JSGF text.
    :param timeout: s of ROS time; 0: the server's default.
    :param action: name of the listen action.
    :raises ValueError: for a grammar or a timeout that cannot be used.
    """

    def __init__(self, grammar: str, timeout: float = 0.0, action: str = "listen", **options: Any) -> None:
        def keep(userdata: Any, result: Any) -> Optional[str]:
            userdata.heard = result.text
            return None if result.text else MISUNDERSTOOD

        words = check_grammar(grammar)
        check_times(timeout=timeout)
        goal = ListenGoal(grammar=grammar, timeout=rospy.Duration(timeout))
        super().__init__(
            action,
            ListenAction,
            goal,
            on_result=keep,
            outcomes=[MISUNDERSTOOD],
            output_keys=["heard"],
            **options,
        )
        self.asks = words
