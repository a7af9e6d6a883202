# SPDX-License-Identifier: Apache-2.0
"""Answers about a run that has ended, from its history or its bag. No node, no master."""

import contextlib
from pathlib import Path
from typing import Iterator, Optional

from merlin_msgs.srv import ExplainRequest, ExplainResponse

from merlin_explain.claims import QuestionError
from merlin_explain.happening.recorded_past import PANEL, RecordedPast
from merlin_explain.node.application_words import ApplicationWords
from merlin_explain.node.explain_node import as_response
from merlin_explain.node.happening_questions import Asked, tell, usable_history
from merlin_monitor.bag.bag_history import BagError, as_bag, history_of
from merlin_monitor.text.sentences import Sentences, read_sentences
from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import parse_domain, read_domain


@contextlib.contextmanager
def recorded_run(path: Path, run: int = 0, domain: Optional[Path] = None) -> Iterator["RecordedRun"]:
    """What was recorded of a run.

    :param path: of a history, of a bag, or of the folder that has one; a history comes first.
    :param run: its number in the history; 0: the newest one.
    :param domain: the PDDL file; None: as it was recorded.
    :raises QuestionError: it cannot be asked, or the domain cannot be read.
    """
    with contextlib.ExitStack() as ends:
        with usable_history():
            bag = as_bag(path)
            try:
                file = path if bag is None else ends.enter_context(history_of(bag, None))
            except BagError as error:
                raise QuestionError(str(error)) from error
        yield RecordedRun(file, run, domain)


class RecordedRun:
    """A run in a history.

    :param file: of the history, or its folder.
    :param run, domain: see :func:`recorded_run`; it raises the same.
    :ivar end: ROS time at which it ends, s.
    """

    def __init__(self, file: Path, run: int, domain: Optional[Path]) -> None:
        self._file, self._run = file, run
        with usable_history(), contextlib.closing(RecordedPast(file, Domain(""), run=run)) as past:
            self.end = past.span()[1]
            self._told = past.moment().section(PANEL)
        text = str(self._told.get("domain") or "")
        if domain is None and not text:
            raise QuestionError(f"{file} does not have the domain of its robot; name its file, --domain")
        with usable_history():
            self._domain = read_domain(str(domain)) if domain is not None else parse_domain(text)

    def answer(self, request: ExplainRequest) -> ExplainResponse:
        """Answers a question about what happened.

        :raises QuestionError: it is wrong, or asks for what was not recorded.
        """
        text = self._told.get("sentences")
        sentences = read_sentences(Path("of the recording"), text) if text else Sentences()
        with usable_history(), contextlib.closing(
            RecordedPast(self._file, self._domain, request.at.to_sec(), run=self._run)
        ) as past:
            words = ApplicationWords(self._domain, sentences)
            interfaces = self._told.get("interfaces") or ()
            return as_response(tell(request, Asked(past.moment(), past, words, interfaces)))
