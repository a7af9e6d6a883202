# SPDX-License-Identifier: Apache-2.0
"""A robot for tests: simulated servers that a test scripts, below actions, or below a whole application."""

import contextlib
import functools
import threading
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Type, Union

import rospy
import yaml
from merlin_msgs.msg import ListenAction, ManipulateAction, RecognizeAction
from move_base_msgs.msg import MoveBaseAction
from sound_play.msg import SoundRequestAction

from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_actions.testing.behaviour import Behaviour
from merlin_actions.testing.simulated_action_server import SimulatedActionServer
from merlin_executor.mission import GoalDispatcher, MissionSM
from merlin_ros.work.threads import start_thread
from merlin_sm.autonomy import label_text
from merlin_sm.states.navigation import POINTS_PARAM

SERVED = {
    "move_base": MoveBaseAction,
    "sound_play": SoundRequestAction,
    "listen": ListenAction,
    "recognize": RecognizeAction,
}
ARM = ("pick", "place", "open", "close")
DURATION = 0.02  # s that each goal takes
LIMIT = 60.0  # s for what a test waits for

Mission = Union[GoalDispatcher, MissionSM]


class MissionEnd(NamedTuple):
    """How a mission ended; true when it succeeded. A failed ``assert`` shows the reason."""

    succeeded: bool
    reason: str
    """The sentence that it has published last."""

    def __bool__(self) -> bool:
        return self.succeeded


class _Run:
    """What runs in a thread of its own."""

    def __init__(self, name: str, run: Callable[[], None]) -> None:
        self._carry_out = run
        self._error: Optional[BaseException] = None
        self._thread = start_thread(name, self._run)

    def _run(self) -> None:
        try:
            self._carry_out()
        except BaseException as error:  # of the test's own code; raised in its thread
            self._error = error

    def _wait(self, name: str, limit: float, where: Callable[[], str]) -> None:
        self._thread.join(limit)
        if self._thread.is_alive():
            raise TimeoutError(f"{name} did not end within {limit:g} s; it is {where()}")
        if self._error is not None:
            raise self._error


class MissionRun(_Run):
    """A mission that runs."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._end = MissionEnd(False, "")
        super().__init__("mission", self._run_mission)

    def cancel(self) -> None:
        """Cancels it: all of its goals are taken back."""
        self._mission.cancel()

    def wait(self, limit: float = LIMIT) -> MissionEnd:
        """Waits for its end.

        :raises TimeoutError: when it has not ended within the limit, s.
        """
        self._wait(self._mission.name, limit, lambda: f"at: {self._mission.reporter.health().message}")
        return self._end

    def _run_mission(self) -> None:
        succeeded = self._mission.carry_out()
        self._end = MissionEnd(succeeded, self._mission.reporter.health().message)


class ActionRun(_Run):
    """An action that runs.

    :ivar outcome: of its machine, once it has ended.
    :ivar reason: the sentence that the last state left.
    """

    def __init__(self, machine: MerlinActionSM, objects: Sequence[str]) -> None:
        if len(objects) != len(machine.parameters):
            wanted = ", ".join(machine.parameters) or "none"
            raise ValueError(
                f"{type(machine).__name__} has the parameters: {wanted}; got {len(objects)} objects"
            )
        self.outcome = ""
        self.reason = ""
        self._machine = machine
        self._parameters = dict(zip(machine.parameters, objects))
        machine.prepare()
        super().__init__("action", self._run_action)

    def cancel(self) -> None:
        """Cancels it, as its bridge would."""
        self._machine.cancel()

    def wait(self, limit: float = LIMIT) -> str:
        """Waits for its end and returns the outcome.

        :raises TimeoutError: when it has not ended within the limit, s.
        """
        states = self._machine.get_active_states
        self._wait(type(self._machine).__name__, limit, lambda: f"in {', '.join(map(label_text, states()))}")
        return self.outcome

    def _run_action(self) -> None:
        self.outcome = self._machine.run_once(self._parameters)
        self.reason = self._machine.reason


class SimulatedRobot:
    """Servers for move_base, sound_play, listen, recognize and an arm, which do what the test says.

    Without a script each goal succeeds after 0.02 s, hears nothing and sees nothing.

    :param name: of one of several robots, below which it serves; empty: the only robot.
    :ivar said: texts that were spoken, in order.
    :ivar drives: goals of move_base, as (x, y) in frame map.
    :ivar handled: what the arm began, as (action, object, place): ("pick", "mug", "desk").
    """

    def __init__(self, name: str = "") -> None:
        self.said: List[str] = []
        self.drives: List[Tuple[float, float]] = []
        self.handled: List[Tuple[str, str, str]] = []
        self._runs: List[MissionRun] = []
        self._folder = Path()
        self._begun = {server: threading.Event() for server in ("move_base", *ARM)}
        notes = {"move_base": self._note_drive, "sound_play": self._note_speech}
        notes.update({each: functools.partial(self._note_arm, each) for each in ARM})
        arm = threading.Lock()  # held while it does one of its actions
        self._servers: Dict[str, SimulatedActionServer] = {
            server: SimulatedActionServer(
                f"{name}/{server}" if name else server,
                action,
                Behaviour(DURATION),
                on_goal=notes.get(server, lambda goal: None),
                body=arm if server in ARM else None,
            )
            for server, action in {**SERVED, **dict.fromkeys(ARM, ManipulateAction)}.items()
        }
        for server in self._servers.values():
            server.start()

    def reset(self, folder: Path = Path()) -> None:
        """Forgets scripts and what was done.

        :param folder: of the test.
        """
        self._folder = folder
        for server in self._servers.values():
            server.follow(Behaviour(DURATION))
        self.said.clear()
        self.drives.clear()
        self.handled.clear()
        for begun in self._begun.values():
            begun.clear()

    def shutdown(self) -> None:
        """Stops serving."""
        for server in self._servers.values():
            server.shutdown()

    # --- the script -------------------------------------------------------------------------------

    def hears(self, *answers: str) -> None:
        """What ``listen`` understands, goal by goal; an empty text is misunderstood; the last one stays."""
        self._servers["listen"].follow(Behaviour(DURATION), {"answers": list(answers)})

    def sees(self, *looks: Union[str, Sequence[str]]) -> None:
        """What ``recognize`` sees: names, or a list of names for each look; the last one stays."""
        values: List[Any] = [look if isinstance(look, str) else list(look) for look in looks]
        self._servers["recognize"].follow(Behaviour(DURATION), {"sees": values})

    def behaves(
        self, server: str, results: Optional[List[Mapping[str, Any]]] = None, **behaviour: Any
    ) -> None:
        """How a server behaves: duration (s), fail, hang (shares, 0..1), see :class:`Behaviour`.

        :param results: fields of its results, goal by goal.
        :raises KeyError: when there is no such server.
        """
        script = {"results": results} if results is not None else None
        self._servers[server].follow(Behaviour(**{"duration": DURATION, **behaviour}), script)

    def points(self, file: Union[str, Path, None] = None, **points: Sequence[float]) -> None:
        """The points of interest: from a world's file, or ``kitchen=(x, y, yaw)``, m and rad in frame map.

        :param file: below the current folder, the test's folder, or a folder above that.
        :raises FileNotFoundError: when it is in none of them.
        """
        known: Dict[str, Any] = {}
        if file is not None:
            text = self._find(Path(file)).read_text(encoding="utf-8")
            known.update(yaml.safe_load(text)["points_of_interest"])
        known.update({name: dict(zip(("x", "y", "yaw"), map(float, pose))) for name, pose in points.items()})
        rospy.set_param(POINTS_PARAM, known)

    # --- what runs --------------------------------------------------------------------------------

    def start(self, action: Type[MerlinActionSM], *objects: str) -> ActionRun:
        """Starts an action.

        :param action: its class.
        :param objects: values of its parameters, in their order.
        """
        return ActionRun(action(), objects)

    def run(self, action: Type[MerlinActionSM], *objects: str, limit: float = LIMIT) -> ActionRun:
        """Runs an action to its end."""
        run = self.start(action, *objects)
        run.wait(limit)
        return run

    def mission(self, mission: Mission, limit: float = LIMIT) -> MissionEnd:
        """Runs a mission to its end, below an application that runs; true when it succeeded."""
        return self.start_mission(mission, limit).wait(limit)

    def start_mission(self, mission: Mission, limit: float = LIMIT) -> MissionRun:
        """Starts a mission below an application that runs; it is cancelled when the test ends.

        :param limit: s for each part of the application to be there.
        """
        mission.wait_for_robot(limit)
        self._runs.append(MissionRun(mission))
        return self._runs[-1]

    def end_missions(self, limit: float = LIMIT) -> None:
        """Cancels the missions that a test has left running, and waits for their end."""
        while self._runs:
            run = self._runs.pop()
            run.cancel()
            with contextlib.suppress(Exception):  # a failed one is the business of its test
                run.wait(limit)

    def wait_for_drive(self, limit: float = LIMIT) -> None:
        """Waits until a drive has begun, the moment for a cancel.

        :raises TimeoutError: when none begins.
        """
        self.wait_for("move_base", limit)

    def wait_for(self, server: str, limit: float = LIMIT) -> None:
        """Likewise, for move_base or an action of the arm."""
        if not self._begun[server].wait(limit):
            raise TimeoutError(f"no goal of {server} began within {limit:g} s")

    def _find(self, file: Path) -> Path:
        for base in (Path(), self._folder, *self._folder.parents):
            if (base / file).is_file():
                return base / file
        raise FileNotFoundError(f"there is no {file} in {Path.cwd()}, {self._folder} or a folder above it")

    def _note_drive(self, goal: Any) -> None:
        position = goal.target_pose.pose.position
        self.drives.append((position.x, position.y))
        self._begun["move_base"].set()

    def _note_arm(self, action: str, goal: Any) -> None:
        self.handled.append((action, goal.object, goal.place))
        self._begun[action].set()

    def _note_speech(self, goal: Any) -> None:
        self.said.append(goal.sound_request.arg)
