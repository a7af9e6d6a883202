# SPDX-License-Identifier: Apache-2.0
"""The panel "Why?": operators ask, all read the answers. It records what past runs are asked with."""

import re
import threading
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional

from merlin_msgs.srv import Explain, ExplainRequest, ExplainResponse
from std_msgs.msg import String

from merlin_explain.execution.recorded_past import PANEL
from merlin_monitor.listeners.panel import Panel
from merlin_monitor.listeners.ros_system import RosSystem
from merlin_monitor.panels.control import SENTENCES
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.text.phrase import say
from merlin_ros.call_scope import CallScope
from merlin_ros.service_proxy import ServiceProxy
from merlin_ros.work.threads import start_thread

LIMIT = 60.0  # s of wall time for an answer: longer than any question takes
KEPT = 5  # answers
LONGEST = 4000  # characters of what is asked about
SETTINGS = ("planner_command", "anytime", "time_limit")  # of the planner, for plans of past runs
_METRIC = re.compile(r"\(:metric\b", re.IGNORECASE)
_TIMED = re.compile(r"\(at\s+[\d.][\d.e+-]*\s+\(", re.IGNORECASE)
_PARENTHESIS = re.compile(r"[()]")


def _expressions(begin: "re.Pattern[str]", text: str) -> List[str]:
    """The expressions of a PDDL text that begin so. They are not parsed: a problem may have 10 000 facts."""
    found = []
    for match in begin.finditer(text):
        depth = 0
        for each in _PARENTHESIS.finditer(text, match.start()):
            depth += 1 if each[0] == "(" else -1
            if not depth:
                found.append(text[match.start() : each.end()])
                break
    return found


class WhyPanel(Panel):
    """Questions and their answers, one question at a time."""

    name, title, place, width = PANEL, "Why?", 18, 12
    script = "package://merlin_explain/web/why.js"

    def __init__(self, state: MonitorModel, ros: RosSystem) -> None:
        super().__init__(state, ros)
        self._knowledge, self._dispatcher, self._problem, self._planner = (
            self.ros.resolve(str(self.ros.parameter(f"~{name}", f"rosplan_{name}")))
            for name in ("knowledge_base", "plan_dispatcher", "problem_interface", "planner_interface")
        )
        self._service = ServiceProxy("merlin/explain", Explain, timeout=LIMIT)
        self._lock = threading.Lock()  # guards the field below
        self._asking: Optional[CallScope] = None
        self._domain: Any = self  # with which the files were read; not yet
        if state.history is not None:
            self.set("clock", round(state.history.now() - time.monotonic(), 3))

    def start(self) -> None:
        """Follows the problems: the other panels keep the knowledge, and not these parts of a problem."""
        self.subscribe(f"{self._problem}/problem_instance", String, self._note_problem)

    def _note_problem(self, message: String, at: float) -> None:
        metric, timed = (_expressions(begin, message.data) for begin in (_METRIC, _TIMED))
        words = [word for each in metric for word in each.split()]  # a text of the state is bounded
        self.set("problem", {"at": at, "metric": words, "timed": timed})

    def look(self, topics: Dict[str, str]) -> None:
        """Takes the texts of the domain and of the sentences, anew with another domain."""
        domain = self.state.tree.get("knowledge", "domain")
        if domain != self._domain:
            self._domain = domain
            for field, parameter in (("domain", f"{self._knowledge}/domain_path"), ("sentences", SENTENCES)):
                lines = self._text_of(parameter).splitlines()  # a text of the state is bounded
                self.state.inbox.put(self.set, field, lines)
            planner = self.ros.parameter(self._planner, {})
            settings = {name: planner[name] for name in SETTINGS if name in planner}
            self.state.inbox.put(self.set, "planner", settings)

    def check(self, at: float, wall: float) -> None:
        """Notes which nodes apply effects."""
        answering = self.ros.publishers_of(f"{self._dispatcher}/action_feedback")
        own = self.ros.publishers_of(f"{self._dispatcher}/action_dispatch")
        self.set("interfaces", sorted(set(answering) - set(own)))

    def _text_of(self, parameter: str) -> str:
        """The text of the file in a parameter; empty: it is not on this computer. A bag has the text."""
        named = self.ros.parameter(parameter, "")
        if isinstance(named, dict):
            return str(named.get("text", ""))
        try:
            return Path(str(named)).expanduser().read_text(encoding="utf-8")
        except (OSError, ValueError):
            return ""

    # --- questions ------------------------------------------------------------------------------------------

    def requests(self) -> Mapping[str, Callable[[Dict[str, Any], str], str]]:
        """``why``, with the fields of ``merlin_msgs/Explain``, and ``why_not_wanted``."""
        return {"why": self._ask, "why_not_wanted": self._take_back}

    def _ask(self, fields: Dict[str, Any], by: str) -> str:
        request = ExplainRequest(question=_text(fields, "question"), about=_text(fields, "about"))
        request.facts, request.goals = (
            list(filter(None, [_text(fields, name)])) for name in ("facts", "goals")
        )
        with self._lock:
            if self._asking is not None:
                raise ValueError("Another question is being answered: wait, or take it back.")
            start_thread("question", self._answer, request, by)
            self._asking = CallScope()
        return "Asked; the answer comes below."

    def _take_back(self, fields: Dict[str, Any], by: str) -> str:
        with self._lock:
            if self._asking is None:
                return "No question is being answered."
            self._asking.end()
        return "The question was taken back."

    def _answer(self, request: ExplainRequest, by: str) -> None:
        asked = {name: getattr(request, name) for name in ("question", "about", "facts", "goals")}
        asked.update(by=by, at=self.ros.time())
        self.state.inbox.put(self.set, "asked", asked)
        with self._lock:
            scope = self._asking or CallScope()
        answer = ExplainResponse(sentence="taken back")
        try:
            with scope:
                answer = self._service(request)
        except Exception as error:  # also of a text that no message can have
            answer.sentence = answer.sentence if scope.ended else str(error)
        finally:
            self.state.inbox.put(self._answered, asked, answer)
            with self._lock:
                self._asking = None

    def _answered(self, asked: Dict[str, Any], answer: ExplainResponse) -> None:
        claims = [
            {"text": claim.text, "evidence": list(map(_shown, claim.evidence))} for claim in answer.claims
        ]
        before = self.state.tree.get(PANEL, "answers", default=[])
        shown = {
            **asked,
            "number": before[0]["number"] + 1 if before else 1,
            "ok": answer.ok,
            "sentence": answer.sentence,
            "claims": claims,
        }
        self.set("answers", [shown, *before][:KEPT])
        self.set("asked", None)
        what = " ".join(filter(None, [asked["question"], asked["about"], *asked["facts"], *asked["goals"]]))
        self.report("control", say("{client} asks: {what}", client=asked["by"], what=what), asked["at"])


def _shown(evidence: Any) -> str:
    step = f"step {evidence.step}: " if evidence.step else ""
    version = f" (version {evidence.version})" if evidence.version else ""
    return f"{evidence.kind}: {step}{evidence.text}{version}"


def _text(fields: Dict[str, Any], name: str) -> str:
    text = fields.get(name, "")
    if not isinstance(text, str) or len(text) > LONGEST:
        raise ValueError(f"{name} is a text of {LONGEST} characters at most.")
    return text.strip()
