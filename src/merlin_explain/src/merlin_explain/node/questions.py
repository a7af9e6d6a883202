# SPDX-License-Identifier: Apache-2.0
"""Which function answers which question: ``answer(question, system) -> Answer``.

It is imported when it is first asked. It raises QuestionError where the question is wrong.
"""

from typing import Callable, Dict

from merlin_msgs.srv import ExplainRequest

from merlin_explain.claims import Answer, Question, QuestionError
from merlin_explain.node.robot_system import RobotSystem
from merlin_ros.class_path import load_function

Answering = Callable[[Question, RobotSystem], Answer]

#: Question → its function.
QUESTIONS: Dict[str, str] = {
    ExplainRequest.WHY: "merlin_explain.node.plan_questions:why",
    ExplainRequest.WHY_NOT: "merlin_explain.node.plan_questions:why_not",
    ExplainRequest.NO_PLAN: "merlin_explain.node.plan_questions:no_plan",
    ExplainRequest.WHAT_IF: "merlin_explain.node.plan_questions:what_if",
    ExplainRequest.WAITING: "merlin_explain.node.happening_questions:waiting",
    ExplainRequest.FAILED: "merlin_explain.node.happening_questions:failed",
    ExplainRequest.SO: "merlin_explain.node.happening_questions:so",
    ExplainRequest.DOING: "merlin_explain.node.happening_questions:doing",
}


def answering(question: str) -> Answering:
    """The function for a question.

    :raises QuestionError: there is none.
    """
    path = QUESTIONS.get(question)
    if path is None:
        raise QuestionError(f"there is no question '{question}', only {', '.join(QUESTIONS)}")
    return load_function(path)
