# SPDX-License-Identifier: Apache-2.0
"""A web server over a model, with a robot that notes what is asked of it."""

import asyncio
import json
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence

import aiohttp

from merlin_monitor.access.operators import Operators, write_operators
from merlin_monitor.access.tls import ServerTls
from merlin_monitor.access.web_access import WebAccess
from merlin_monitor.state.history_store import HistoryStore
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.text.wording import Wording
from merlin_monitor.web.page_control import ControlError, RobotRequests
from merlin_monitor.web.web_server import WebServer

WEB = Path(__file__).resolve().parents[3] / "src" / "merlin_monitor" / "web"
TOKEN = "ünguessable, really"


class FakeRobot(RobotRequests):
    """Notes what is asked of it."""

    def __init__(self) -> None:
        self.planning = self
        self.calls: List[tuple] = []
        self.presses: List[str] = []  # of the button that stops
        self.holder = ""  # who else holds the base
        self.running = ""  # what a change by hand contradicts

    def check(self, goal: str) -> None:
        if "moon" in goal:
            raise ControlError("there is no object 'moon'")

    def send(self, goal: str, priority: int, by: str) -> str:
        self.calls.append(("send", goal, priority, by))
        return "/monitor-1"

    def cancel(self, request: str, by: str) -> str:
        self.calls.append(("cancel", request, by))
        return "Sent."

    def cancel_all(self, by: str) -> str:
        self.calls.append(("cancel_all", by))
        return "Sent."

    def pause(self, pause: bool, by: str) -> str:
        self.calls.append(("pause", pause, by))
        return "Paused."

    def stop(self, by: str, press: str) -> str:
        self.calls.append(("stop", by))
        self.presses.append(press)
        return "stopped until merlin/release is called"

    def release(self, by: str, seen: str) -> str:
        if self.holder:
            if seen != self.holder:
                raise ControlError(f"Not released yet: {self.holder}.", self.holder)
            self.calls.append(("release", by))
            return "The base may drive again."
        raise ControlError("The base was not released: no velocity guard runs.")

    def plan(self, goal: str, without: Sequence[str], by: str) -> Dict[str, Any]:
        self.calls.append(("plan", goal, list(without), by))
        steps = [
            {"text": f"(navigate {place})", "words": f"driving to {place}", "start": at, "duration": 10.0}
            for at, place in ((0.0, "hall"), (10.0, "kitchen"))
            if f"(navigate {place})" not in without
        ]
        plan = {
            "goal": goal,
            "words": Wording().goal(goal),
            "without": list(without),
            "after": ["driving to the hall"],
            "steps": steps,
            "seconds": 10.0 * len(steps),
        }
        return {"done": "Not carried out.", "plan": plan}

    def hold_before(self, texts: Sequence[str], by: str) -> str:
        self.calls.append(("hold_before", list(texts), by))
        return "Held."

    def go_on(self, step: bool, by: str) -> str:
        self.calls.append(("go_on", step, by))
        return "Begins."

    def leave(self, state: str, outcome: str, within: str, by: str) -> str:
        self.calls.append(("leave", state, outcome, within, by))
        return "It is left."

    def set_autonomy(self, level: str, by: str) -> str:
        self.calls.append(("set_autonomy", level, by))
        return "It is set."

    def acknowledge(self, problem: str, by: str) -> str:
        self.calls.append(("acknowledge", problem, by))
        return "Noted."

    def change(self, facts: str, by: str, seen: str) -> str:
        if self.running and seen != self.running:
            raise ControlError(f"Nothing was changed yet: {self.running} runs.", self.running)
        self.calls.append(("change", facts, by))
        return "The knowledge was changed."


class Served:
    """A running server and what belongs to it.

    :param host: on which it says that it listens; it listens on this machine alone.
    """

    def __init__(
        self,
        folder: Path,
        token: str,
        tls: Optional[ServerTls] = None,
        open_stop: bool = False,
        names: Sequence[str] = (),
        host: str = "127.0.0.1",
        open_look: bool = False,
    ) -> None:
        self.state = MonitorModel(Inbox(), HistoryStore(folder / "history.sqlite", 100_000))
        self.robot = FakeRobot()
        control = self.robot if token else None
        self.operators = folder / "operators.yaml"
        if token:
            write_operators(self.operators, {"Ana": token})
        self.scripts = {"plan": WEB / "panels" / "plan.js"}
        self.server = WebServer(
            self.state,
            WebAccess(host, names, Operators(self.operators), open_stop, open_look=open_look),
            control,
            scripts=self.scripts,
            tls=tls.context if tls else None,
        )
        self.state.start()
        self.server.start()
        self.url = self.server.address

    def stop(self) -> None:
        self.server.stop()
        self.state.stop()


def ask(
    url: str, path: str = "", method: str = "GET", headers: Optional[Dict[str, str]] = None, body: Any = None
) -> Any:
    """One request; the answer with its text, or as bytes in `body`."""

    async def run() -> Any:
        async with aiohttp.ClientSession() as session:
            data = json.dumps(body) if body is not None and not isinstance(body, (bytes, str)) else body
            async with session.request(method, url + path, headers=headers or {}, data=data) as answer:
                answer.content_bytes = await answer.read()
                answer.said = answer.content_bytes.decode("utf-8", "replace")
                return answer

    return asyncio.run(run())
