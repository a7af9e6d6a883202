# SPDX-License-Identifier: Apache-2.0
"""Answers about a run that has ended, from its history or its bag. No node, no master."""

import contextlib
from pathlib import Path
from typing import Callable, Optional

import rospy
from merlin_msgs.srv import ExplainRequest, ExplainResponse

from merlin_explain.claims import QuestionError
from merlin_explain.execution.recorded_past import PANEL, RecordedPast
from merlin_explain.node.application_words import ApplicationWords
from merlin_explain.node.execution_questions import tell, usable_history
from merlin_explain.node.explain_node import as_response
from merlin_monitor.text.sentences import Sentences, SentencesError, read_sentences
from merlin_monitor.web.open_command import BagError, as_bag, history_of
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.text_reader import text_of


def ask_recording(
    path: Path,
    request: ExplainRequest,
    moment: Optional[Callable[[float], rospy.Time]] = None,
    run: int = 0,
    domain: Optional[Path] = None,
) -> ExplainResponse:
    """Answers a question.

    :param path: of a history, of a bag, or of the folder that has one; a history comes first.
    :param moment: takes the ROS time at which the run ends, s; returns the one that is meant. None: the end.
    :param run: its number in the history; 0: the newest one.
    :param domain: the PDDL file; None: as it was recorded.
    :raises QuestionError: the question is wrong, or the recording cannot be asked.
    """
    with contextlib.ExitStack() as ends, usable_history():
        try:
            bag = as_bag(path)
            file = path if bag is None else ends.enter_context(history_of(bag, None))
        except BagError as error:
            raise QuestionError(str(error)) from error
        with contextlib.closing(RecordedPast(file, Domain(""), run=run)) as past:
            end, shown = past.span()[1], past.moment().section(PANEL)
        if domain is None and not shown.get("domain"):
            raise QuestionError(f"{path} does not have the domain of its robot; name its file, --domain")
        domain_text = "\n".join(shown["domain"]) if domain is None else text_of(str(domain))
        known = parse_domain(domain_text, str(domain or path))
        text = "\n".join(shown.get("sentences") or ())
        try:
            words = ApplicationWords(known, read_sentences(path, text) if text else Sentences())
        except SentencesError as error:
            raise QuestionError(str(error)) from error
        at = moment(end).to_sec() if moment else 0.0
        with contextlib.closing(RecordedPast(file, known, at, run=run)) as past:
            interfaces = shown.get("interfaces") or ()
            return as_response(tell(request, past.moment(), past, domain_text, words, interfaces))
