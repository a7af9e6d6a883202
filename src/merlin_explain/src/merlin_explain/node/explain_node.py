# SPDX-License-Identifier: Apache-2.0
"""Node: answers questions. It only listens, calls and computes: nothing moves because of a question."""

import threading
from typing import Callable, Dict

import rospy
from merlin_msgs.msg import Claim as ClaimMessage
from merlin_msgs.msg import Evidence as EvidenceMessage
from merlin_msgs.srv import Explain, ExplainRequest, ExplainResponse

from merlin_explain.claims import Answer, Evidence, QuestionError
from merlin_explain.node.robot_system import USUAL, Names, RobotSystem
from merlin_pddl.text_reader import PddlError, shortened
from merlin_planning.knowledge_client import KnowledgeError
from merlin_ros.call_scope import CallScope
from merlin_ros.class_path import load_function
from merlin_ros.health import OK, Health, HealthReporter
from merlin_ros.master.master_link import MasterSilent
from merlin_ros.node import run_node
from merlin_ros.parameters import ParameterError, graph_name
from merlin_ros.ports.service_server import while_wanted
from merlin_ros.processes.process_priority import lower_priority
from merlin_ros.service_proxy import ServiceError
from merlin_ros.work.threads import log_failure

#: Nice value: below the robot's own nodes.
NICENESS = 10
#: s of wall time that a question waits for those before it.
WAIT = 15.0
BUSY = "other questions are being answered; ask again in a moment"
#: What is refused with its own words.
REFUSALS = (QuestionError, PddlError, ServiceError, KnowledgeError, MasterSilent, ParameterError)

Answering = Callable[[ExplainRequest, RobotSystem], Answer]
_PLANS = (ExplainRequest.WHY, ExplainRequest.WHY_NOT, ExplainRequest.NO_PLAN, ExplainRequest.WHAT_IF)
_EXECUTION = (ExplainRequest.WAITING, ExplainRequest.FAILED, ExplainRequest.SO, ExplainRequest.DOING)
#: The function of questions about what happens, and about plans of a past moment.
OF_MOMENTS = "merlin_explain.node.execution_questions:of_execution"
#: Question → its function, which raises QuestionError where the question is wrong; imported when it is asked.
QUESTIONS: Dict[str, str] = {
    **dict.fromkeys(_PLANS, "merlin_explain.node.plan_questions:of_plans"),
    **dict.fromkeys(_EXECUTION, OF_MOMENTS),
}


class Explainer:
    """Serves ``merlin/explain``: one question after the other, each as long as its client waits for it.

    :param system: what is asked.
    """

    def __init__(self, system: RobotSystem) -> None:
        self._system = system
        self._one = threading.Lock()  # held while a question is answered

    def offer(self, name: str) -> rospy.Service:
        """Offers it under a name."""
        return rospy.Service(name, Explain, self.answer)

    def answer(self, request: ExplainRequest) -> ExplainResponse:
        """Answers a question, or says why not."""
        if not self._one.acquire(timeout=WAIT):
            return ExplainResponse(ok=False, sentence=BUSY)
        try:
            with CallScope() as scope, while_wanted(scope.end):
                found = self._answer(request)
        except REFUSALS as error:  # which may repeat what was asked
            return ExplainResponse(ok=False, sentence=shortened(str(error)))
        except Exception:  # what one question meets must not keep the node from answering others
            said = log_failure(f"explain: {request.question}")
            return ExplainResponse(ok=False, sentence=f"not found out: {said}")
        finally:
            self._one.release()
        return as_response(found)

    def health(self) -> Health:
        """Whether it answers."""
        return Health(OK, "answers a question" if self._one.locked() else "ready")

    def _answer(self, question: ExplainRequest) -> Answer:
        question.question, question.about = question.question or ExplainRequest.WHY, question.about.strip()
        path = QUESTIONS.get(question.question)
        if path is None:
            raise QuestionError(f"there is no question '{question.question}', only {', '.join(QUESTIONS)}")
        answering: Answering = load_function(OF_MOMENTS if question.at else path)
        return answering(question, self._system)


def as_response(answer: Answer) -> ExplainResponse:
    """An answer as a message."""
    claims = [
        ClaimMessage(claim.kind, claim.text, [_evidence(each) for each in claim.evidence])
        for claim in answer.claims
    ]
    return ExplainResponse(True, answer.sentence, claims)


def _evidence(evidence: Evidence) -> EvidenceMessage:
    time = rospy.Time.from_sec(max(0.0, evidence.time))
    return EvidenceMessage(evidence.kind, evidence.text, evidence.step, evidence.version, time)


def main() -> int:
    """Runs the node; returns the exit code."""
    lower_priority(NICENESS)
    return run_node("merlin_explain", _start)


def _start() -> None:
    fields = ("knowledge_base", "problem_interface", "planner_interface", "plan_dispatcher", "executor")
    names = Names(*(graph_name(f"~{field}", default) for field, default in zip(fields, USUAL)))
    explainer = Explainer(RobotSystem(names))
    explainer.offer(f"{names.executor}/explain")
    HealthReporter({"explainer": explainer.health}).start()
