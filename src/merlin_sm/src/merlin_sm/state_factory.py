# SPDX-License-Identifier: Apache-2.0
"""MerlinStateFactory: makes states by name (paper, section 3.2.1)."""

import contextlib
from typing import Any, Callable, Dict, Iterator, List

import smach
from merlin_sm.states.action_state import ActionState
from merlin_sm.states.dialogue import AskSM
from merlin_sm.states.function_state import FunctionState
from merlin_sm.states.knowledge import KnowledgeState
from merlin_sm.states.manipulation import CloseState, OpenState, PickState, PlaceState
from merlin_sm.states.navigation import NavigationState
from merlin_sm.states.planning import DispatchPlanState, GenerateProblemState, ParsePlanState, PlanState
from merlin_sm.states.recognition import DetectState, RecognizeState
from merlin_sm.states.ros_calls import ServiceCallState, TopicState
from merlin_sm.states.speech import ListenState, SpeakState
from merlin_sm.states.wait import WaitState
from merlin_sm.states.while_state import WhileSM

StateMaker = Callable[..., smach.State]


class MerlinStateFactory:
    """A registry from name to state class: of the ready states (docs/states.md), and those of users."""

    _makers: Dict[str, StateMaker] = {
        "action": ActionState,
        "ask": AskSM,
        "close": CloseState,
        "detect": DetectState,
        "dispatch_plan": DispatchPlanState,
        "function": FunctionState,
        "generate_problem": GenerateProblemState,
        "knowledge": KnowledgeState,
        "listen": ListenState,
        "navigation": NavigationState,
        "open": OpenState,
        "parse_plan": ParsePlanState,
        "pick": PickState,
        "place": PlaceState,
        "plan": PlanState,
        "recognize": RecognizeState,
        "service": ServiceCallState,
        "speak": SpeakState,
        "topic": TopicState,
        "wait": WaitState,
        "while": WhileSM,
    }
    _fixed = True  # a registered name keeps its maker

    @classmethod
    def register(cls, name: str, maker: StateMaker) -> StateMaker:
        """Registers a state class, or any function that makes a state, under a name.

        :raises ValueError: when the name is taken by another one.
        """
        if cls._fixed and cls._makers.get(name, maker) is not maker:
            raise ValueError(f"the state {name!r} is registered already, as {cls._makers[name]}")
        cls._makers[name] = maker
        return maker

    @classmethod
    def create(cls, name: str, *args: Any, **options: Any) -> smach.State:
        """Makes a new state; arguments are those of its class.

        :raises KeyError: for an unknown name; the text lists those there are.
        """
        return cls.maker(name)(*args, **options)

    @classmethod
    def maker(cls, name: str) -> StateMaker:
        """What makes the state of a name.

        :raises KeyError: for an unknown name; the text lists those there are.
        """
        if name not in cls._makers:
            raise KeyError(f"no state {name!r}; registered are: {', '.join(cls.names())}")
        return cls._makers[name]

    @classmethod
    @contextlib.contextmanager
    def renewed(cls) -> Iterator[None]:
        """Within it, names may be registered anew; all is as before when it is left by an error."""
        kept = dict(cls._makers)
        cls._fixed = False
        try:
            yield
        except BaseException:
            cls._makers = kept
            raise
        finally:
            cls._fixed = True

    @classmethod
    def names(cls) -> List[str]:
        """The registered names, sorted."""
        return sorted(cls._makers)
