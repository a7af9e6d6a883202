"""A web server over a model, with a robot that notes what is asked of it."""

import asyncio
import json
from pathlib import Path
from typing import Any, Dict, List, Optional

import aiohttp

from merlin_monitor.access.operators import Operators, write_operators
from merlin_monitor.access.web_access import WebAccess
from merlin_monitor.state.inbox import Inbox
from merlin_monitor.state.monitor_model import MonitorModel
from merlin_monitor.web.control import Control, ControlError
from merlin_monitor.web.web_server import WebServer

WEB = Path(__file__).resolve().parents[3] / "src" / "merlin_monitor" / "web"
TOKEN = "ünguessable, really"


class FakeRobot:
    """Notes what is asked of it."""

    def __init__(self) -> None:
        self.calls: List[tuple] = []

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

    def stop(self, by: str) -> str:
        self.calls.append(("stop", by))
        return "stopped until merlin/release is called"

    def release(self, by: str) -> str:
        raise ControlError("The base was not released: no velocity guard runs.")


class Served:
    """A running server and what belongs to it."""

    def __init__(self, folder: Path, token: str) -> None:
        self.state = MonitorModel(Inbox(), folder / "history.sqlite")
        self.robot = FakeRobot()
        control = Control(self.robot) if token else None
        self.operators = folder / "operators.yaml"
        if token:
            write_operators(self.operators, {"Ana": token})
        self.server = WebServer(
            self.state,
            WEB,
            WebAccess("127.0.0.1", operators=Operators(self.operators)),
            control,
            scripts={"plan": WEB / "panels" / "plan.js"},
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
