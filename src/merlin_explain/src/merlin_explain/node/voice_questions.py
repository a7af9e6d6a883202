# SPDX-License-Identifier: Apache-2.0
"""Node: hears "why?" and "what are you doing?", and speaks the answer, while nothing else listens or speaks.

It has a listener of its own, so the application's one never waits for it. It neither listens nor speaks while
a goal of the application's actions runs, and gives both up when one begins.
"""

import re
import threading
from functools import partial
from typing import Any, Callable, Dict, List, Mapping

import rospy
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from merlin_msgs.msg import ListenAction, ListenGoal
from merlin_msgs.srv import Explain, ExplainRequest, ExplainResponse
from sound_play.msg import SoundRequest
from std_msgs.msg import Bool

from merlin_ros.actions.action_client import ActionClient
from merlin_ros.deadline import Deadline
from merlin_ros.health import OK, WARN, Health, HealthReporter
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError, graph_name
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_ros.work.threads import failure_logged, start_thread

#: Question → the phrases that ask it; ``when`` is that part of the answer to ``doing``.
PHRASES = {
    "why": ["why", "why are you doing that", "why do you do that"],
    "doing": ["what are you doing", "what do you do"],
    "when": ["when do you come", "when will you be ready"],
}
ASKED = {
    "why": ExplainRequest.WHY,
    "doing": ExplainRequest.DOING,
    "when": ExplainRequest.DOING,
    "waiting": ExplainRequest.WAITING,
    "failed": ExplainRequest.FAILED,
}
UNKNOWN = "I do not know."
LISTENING = 60.0  # s of ROS time for one goal of the listener; the next one follows
PATIENCE = 10.0  # s of running time that an answer waits for a free moment; later it is not wanted any more
ANSWER_LIMIT = 20.0  # s of wall time for an answer
RETRY = 5.0  # s of running time until it tries again what failed, and looks for what fell silent
SILENT = 5.0  # s of running time: what has not repeated its status for so long does nothing
_GOING = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING)


def questions_of(phrases: Any) -> Dict[str, str]:
    """Phrase → question, of a table of questions with their phrases.

    :raises ParameterError: it is another thing, or a phrase asks two questions.
    """
    if not isinstance(phrases, dict) or not phrases or not set(phrases) <= set(ASKED):
        raise ParameterError(f"parameter ~questions is {phrases!r}, not phrases of {', '.join(ASKED)}")
    found: Dict[str, str] = {}
    for question, listed in phrases.items():
        if not isinstance(listed, list) or not listed:
            raise ParameterError(f"parameter ~questions/{question} is {listed!r}, not a list of phrases")
        for phrase in listed:
            if not isinstance(phrase, str) or not re.fullmatch(r"[a-z']+( [a-z']+)*", phrase):
                raise ParameterError(
                    f"parameter ~questions/{question}: {phrase!r} is not words in lower case"
                )
            if found.setdefault(phrase, question) != question:
                raise ParameterError(f"parameter ~questions: '{phrase}' asks {found[phrase]} and {question}")
    return found


def spoken(question: str, answer: ExplainResponse, now: float) -> str:
    """What is said of an answer: its first sentence, or when the work ends; empty: it was not found out.

    :param now: ROS time, s: a person has no watch that shows it.
    """
    text = answer.sentence if answer.ok else ""
    estimate = next((claim for claim in answer.claims if claim.kind == "estimate"), None)
    if question == "when" and estimate is not None:
        end = max((each.time.to_sec() for each in estimate.evidence), default=0.0)
        text = _when(end - now) if end else estimate.text
    first = re.split(r"(?<=[.!?])\s+(?=[A-Z“])", text, maxsplit=1)[0]
    said = re.sub("[“”]", "", first).replace("_", " ")
    return said[:1].upper() + said[1:]


def _when(left: float) -> str:
    """:param left: s until the end; below 0: since then."""
    span = max(2.0, abs(left))
    said = f"{span:.0f} seconds" if span < 100.0 else f"{span / 60.0:.0f} minutes"
    return f"I will be ready in about {said}." if left > 0.0 else f"I wanted to be ready {said} ago."


def asked(question: str, robot: str, explain: Callable[[ExplainRequest], ExplainResponse]) -> ExplainResponse:
    """The answer to a question; of several robots that of the one which was asked.

    :param question: one of :data:`ASKED`.
    :param robot: its name in the plan; empty: there is only one.
    :param explain: answers.
    """
    about = ""
    if robot and question in ("why", "doing"):
        answer = explain(ExplainRequest(question=ExplainRequest.DOING))
        steps = {
            each.text: claim for claim in answer.claims if claim.kind == "running" for each in claim.evidence
        }
        about = next((text for text in steps if robot in text.strip("()").split()), "")
        if not about:
            return ExplainResponse(
                answer.ok, f"{robot} does nothing now." if answer.ok else answer.sentence, []
            )
        if question == "doing":
            own = steps[about]
            return ExplainResponse(True, f"{own.text.partition('”')[0]}”.", [own])
    return explain(ExplainRequest(question=ASKED[question], about=about))


class Moments:
    """Which moments are free: no goal of these actions runs, and the robot does not speak."""

    def __init__(self, actions: List[str]) -> None:
        self.changed = threading.Condition()  # guards the fields below
        self._running: Dict[str, Deadline] = {}  # an action that runs → until when that counts
        self._speaking = False
        for name in actions:
            rospy.Subscriber(f"{name}/status", GoalStatusArray, partial(self._note, name), tcp_nodelay=True)
        rospy.Subscriber("sound_play/is_speaking", Bool, self._hear, tcp_nodelay=True)

    @property
    def used(self) -> bool:
        """Whether an action of the application runs; asked with `changed` held."""
        return any(until.remaining() > 0.0 for until in self._running.values())

    @property
    def free(self) -> bool:
        """Whether nothing listens or speaks; asked with `changed` held."""
        return not self.used and not self._speaking

    def wait_free(self, limit: float) -> bool:
        """Waits for a free moment, s of running time."""
        with self.changed:
            return Deadline(limit).wait(self.changed, lambda: self.free)

    def _note(self, name: str, message: GoalStatusArray) -> None:
        with self.changed:
            self._running.pop(name, None)
            if any(each.status in _GOING for each in message.status_list):
                self._running[name] = Deadline(SILENT)
            self.changed.notify_all()

    def _hear(self, message: Bool) -> None:
        with self.changed:
            self._speaking = message.data
            self.changed.notify_all()


class VoiceQuestions:
    """Hears questions and answers them, in a thread of its own.

    :param phrases: phrase → question.
    :param moments: those that are free.
    :param listener: name of the action that hears.
    :param explain: name of the service that answers.
    :param robot: that is asked, of several in one plan; empty: there is only one.
    """

    def __init__(
        self, phrases: Mapping[str, str], moments: Moments, listener: str, explain: str, robot: str
    ) -> None:
        self._phrases = phrases
        self._robot = robot
        self._moments = moments
        self._grammar = f"#JSGF V1.0; grammar questions; public <question> = {' | '.join(phrases)};"
        self._listener = ActionClient(listener, ListenAction)
        self._explain = ServiceProxy(explain, Explain, timeout=ANSWER_LIMIT)
        # One after the other, and behind the goals of sound_play, which also end it.
        self._sound = rospy.Publisher("robotsound", SoundRequest, queue_size=5)
        self._trouble = ""  # why it does not hear

    def start(self) -> None:
        """Begins to listen."""
        start_thread("voice questions", self._work)

    def health(self) -> Health:
        """Whether it can hear and speak."""
        silent = "" if self._sound.get_num_connections() else f"nothing speaks on {self._sound.resolved_name}"
        trouble = self._trouble or silent
        return Health(WARN, trouble) if trouble else Health(OK, "listens while nothing else does")

    def _work(self) -> None:
        while not rospy.is_shutdown():
            with failure_logged():  # one question must not end those that follow
                if not self._listener.wait_for_server(RETRY):
                    self._trouble = f"nothing listens: {self._listener.missing}"
                elif self._moments.wait_free(RETRY):
                    self._answer(self._listen())

    def _listen(self) -> str:
        """What was asked; empty: nothing, or the moment was not free any more."""
        changed = self._moments.changed

        def ended(_: Any) -> None:
            with changed:
                changed.notify_all()

        wanted = ListenGoal(grammar=self._grammar, timeout=rospy.Duration.from_sec(LISTENING))
        goal = self._listener.send(wanted, on_done=ended)
        with changed:
            Deadline(None).wait(changed, lambda: goal.done or not self._moments.free)
            heard = goal.done
        if not heard:
            goal.cancel()
            goal.wait(RETRY)
            return ""
        self._trouble = "" if goal.status == GoalStatus.SUCCEEDED else f"cannot listen: {goal.text}"
        if self._trouble:
            rospy.logwarn_throttle_identical(60.0, f"voice questions: {self._trouble}")
            with changed:
                Deadline(RETRY).wait(changed, rospy.is_shutdown)
            return ""
        return str(goal.result.text)

    def _answer(self, phrase: str) -> None:
        question = self._phrases.get(phrase)
        if question is None:
            return
        try:
            answer = asked(question, self._robot, self._explain)
        except ServiceError as error:
            answer = ExplainResponse(ok=False, sentence=str(error))
        rospy.loginfo(f"asked “{phrase}”: {answer.sentence}")
        if self._moments.wait_free(PATIENCE):
            self._say(spoken(question, answer, rospy.get_time()) or UNKNOWN)

    def _say(self, text: str) -> None:
        """Speaks until the end, or until the application listens or speaks."""
        sound = SoundRequest(sound=SoundRequest.SAY, command=SoundRequest.PLAY_ONCE, volume=1.0, arg=text)
        self._sound.publish(sound)
        with self._moments.changed:
            Deadline(RETRY).wait(self._moments.changed, lambda: not self._moments.free)  # it has begun
            Deadline(LISTENING).wait(self._moments.changed, lambda: self._moments.free or self._moments.used)
            stop = self._moments.used
        if stop:
            sound.command = SoundRequest.PLAY_STOP
            self._sound.publish(sound)


def main() -> int:
    """Runs the node; returns the exit code."""
    return run_node("voice_questions", _start)


def _start() -> None:
    actions: Any = rospy.get_param("~yield_to", ["listen", "sound_play"])
    if not isinstance(actions, list) or not all(isinstance(each, str) and each for each in actions):
        raise ParameterError(f"parameter ~yield_to is {actions!r}, not a list of names of actions")
    phrases = questions_of(rospy.get_param("~questions", PHRASES))
    listener, explain = graph_name("~listener", "questions/listen"), graph_name("~explain", "merlin/explain")
    robot = str(rospy.get_param("~robot", ""))
    voice = VoiceQuestions(phrases, Moments(actions), listener, explain, robot)
    voice.start()
    HealthReporter({"voice questions": voice.health}).start()
