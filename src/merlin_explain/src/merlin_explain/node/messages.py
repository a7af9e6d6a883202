# SPDX-License-Identifier: Apache-2.0
"""Questions and answers as messages."""

import rospy
from merlin_msgs.msg import Claim as ClaimMessage
from merlin_msgs.msg import Evidence as EvidenceMessage
from merlin_msgs.srv import ExplainRequest, ExplainResponse

from merlin_explain.claims import Answer, Evidence, Question


def as_question(request: ExplainRequest) -> Question:
    """The question in a message."""
    return Question(
        request.question or ExplainRequest.WHY,
        request.about.strip(),
        request.include,
        request.without,
        request.first,
        request.facts,
        request.goals,
        request.at.to_sec(),
    )


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
