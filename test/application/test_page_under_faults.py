# SPDX-License-Identifier: Apache-2.0
"""The page says the worst truth: a robot drives, something breaks for 1, 3 and 10 s, and is well again."""

import contextlib
import json
import re
import signal
import time
import urllib.request
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, NamedTuple

import pytest
from chaos.trials import Variant
from chaos.under_test import processes
from chaos.under_test.system import System

from merlin_monitor.panel_board import CHECKS
from merlin_monitor.state import guard_section, health_section
from merlin_ros import health
from merlin_test.chromium import Visit, chromium
from merlin_test.process_signals import hang
from merlin_test.stalled_link import StalledLink

ROOT = Path(__file__).resolve().parents[2]
STORE = ROOT / "src" / "merlin_monitor" / "web" / "store.js"
DOCUMENT = ROOT / "docs" / "reliability-measurements.md"
#: What was seen, s: when it was said after the fault, and when all was well after its end.
SEEN = ROOT / "results" / "page_faults.md"
LASTS = (1.0, 3.0, 10.0)  # s
PATIENCE = 4.0  # how many times a limit a machine that tests something else meanwhile may make of it
WELL = 180.0  # s for everything to be well again
BACK = -3600.0  # s by which a clock is set back

ONE = Variant(base_timeout=0.5, page=True, mission=True)
SET = Variant(base_timeout=0.5, page=True, mission=True, time="set")
TWO = Variant(base_timeout=0.5, page=True, mission=True, robots=("ann", "bob"))


def _of_the_page(name: str) -> float:
    """A time of the page, s."""
    found = re.search(
        rf"^const {name} = (\d+);", (ROOT / "src/merlin_monitor/web/store.js").read_text(), re.M
    )
    assert found, name
    return int(found[1]) / 1000.0


class Span(NamedTuple):
    """From when, and until when something is noticed, s."""

    earliest: float
    latest: float


AT_ONCE = Span(0.0, CHECKS)
SILENCE = Span(health_section.SILENT_AFTER - health.PERIOD, health_section.SILENT_AFTER + CHECKS)
UNWATCHED = Span(guard_section.SILENT_AFTER - CHECKS, guard_section.SILENT_AFTER + CHECKS)
STALLED = Span(_of_the_page("STALLED") - CHECKS, _of_the_page("STALLED") + _of_the_page("LOOK"))

#: Notes what the page says, as a whole, whenever that changes.
RECORD = """() => {
  const text = (id) => (document.getElementById(id)?.textContent || "").trim();
  const problem = document.querySelector("#glance-problem span");
  const said = () => ({
    doing: text("now-doing"), because: text("now-because"), trouble: text("now-trouble"),
    state: text("glance-state"), tone: document.getElementById("glance-state").dataset.tone,
    problem: problem.textContent, grave: problem.dataset.tone === "bad",
    progress: text("glance-progress"), next: text("glance-next"),
    end: text("glance-end").replace(/\\d+/g, "N"),
    title: document.title, icon: document.querySelector("link[rel=icon]").getAttribute("href"),
    news: document.body.dataset.news, time: text("time-at"),
    grey: [...document.querySelectorAll("main [data-silent]")].map((each) => each.id).join(" "),
  });
  const seen = window.seen = [];
  let last = "";
  const look = () => {
    const now = said(), json = JSON.stringify(now);
    if (json !== last) seen.push({ at: performance.now() / 1000, ...now });
    last = json;
  };
  const all = { subtree: true, childList: true, characterData: true, attributes: true };
  new MutationObserver(look).observe(document, all);
  look();
}"""
#: Whether nothing is wrong, the task of the mission, and whether the robot drives in it.
LOOK = """async () => {
  const said = window.seen[window.seen.length - 1];
  const well = said.news === "live" && said.tone !== "bad" && !said.trouble && !said.grey;
  const answer = well && await fetch("state.json").catch(() => null);
  if (!answer) return { well: false };
  const { state: { guard, now } } = await answer.json();
  const drives = said.state === "Working" && guard.state === "passing" && !said.grave;
  return { well: true, task: now.mission.task, drives };
}"""
SAID = "([words, since]) => window.seen.some(({ at, doing }) => at >= since && doing.includes(words))"
SET_CLOCK = """(off) => {
  const Right = window.Right = window.Right || Date;
  window.Date = class extends Right {
    constructor(...given) { if (given.length) super(...given); else super(Right.now() + off); }
    static now() { return Right.now() + off; }
  };
}"""

#: What the browser says of a connection that is cut.
OF_THE_NETWORK = re.compile(r"WebSocket connection|net::ERR_")

End = Callable[[], object]


class Scene:
    """A robot that drives for ever, and its page. Faults return what ends them."""

    def __init__(self, variant: Variant, browser: Any) -> None:
        self.system = System(variant)
        try:
            self.system.start()
            address, token = self.system.page
            end = time.monotonic() + WELL
            while not _serves(address):
                assert time.monotonic() < end, "the monitor does not serve its page"
                time.sleep(0.1)
            self.link = StalledLink(address)
            self.visit = Visit(browser, self.link.url)
            self.visit.wait("() => document.getElementById('glance-state')")
            self.visit.page.evaluate(RECORD)
            self._sign_in(token)
        except BaseException:
            self.system.stop()
            raise

    def close(self) -> None:
        self.visit.close()
        self.link.close()
        self.system.stop()

    def _sign_in(self, token: str) -> None:
        self.visit.page.click("#operator")
        self.visit.page.fill("#token", token)
        self.visit.page.keyboard.press("Enter")
        self.visit.wait_text("#operator", "chaos")

    def wait_driving(self) -> None:
        """Waits until all is well, and the robot begins to drive in another task: it drives for long then."""
        end = time.monotonic() + WELL
        before = None  # the task in which all was well first
        while True:
            now = self.visit.page.evaluate(LOOK)
            if not now["well"]:
                before = None
            elif before is None:
                before = now["task"]
            elif now["drives"] and now["task"] != before:
                return
            assert time.monotonic() < end, f"not well after {WELL:.0f} s:\n{self.text(self.now() - WELL)}"
            self.visit.page.wait_for_timeout(50)

    def now(self) -> float:
        return float(self.visit.page.evaluate("() => performance.now() / 1000"))

    def record(self, since: float) -> List[Dict[str, Any]]:
        """What the page has said since a time, first what it said then."""
        seen = self.visit.page.evaluate("() => window.seen")
        first = max((number for number, said in enumerate(seen) if said["at"] <= since), default=0)
        return list(seen[first:])

    def text(self, since: float) -> str:
        """The record, a line each, and what has changed in it."""
        lines: List[str] = []
        before: Dict[str, Any] = {}
        for said in self.record(since):
            at = said.pop("at") - since
            changed = {each: value for each, value in said.items() if before.get(each) != value}
            lines.append(f"{at:7.2f} {json.dumps(changed, ensure_ascii=False)}")
            before = said
        return "\n".join(lines)

    def hang(self, node: str) -> End:
        pid = self.system.pid(node)
        assert pid is not None, f"{node} does not run"
        hang(pid)
        return lambda: processes.send(pid, signal.SIGCONT)

    def kill(self, node: str) -> End:
        pid = self.system.pid(node)
        assert pid is not None, f"{node} does not run"
        again = processes.respawner(pid)
        assert again is not None, f"nothing starts {node} again"
        hang(again)
        processes.send(pid, signal.SIGKILL)
        return lambda: processes.send(again, signal.SIGCONT)

    def kill_master(self) -> End:
        master = self.system.pid("master")
        assert master is not None, "the master does not run"
        processes.send(master, signal.SIGKILL)
        return self.system.start_master_again

    def stall(self) -> End:
        self.link.stall()
        return self.link.go_on

    def offline(self) -> End:
        self.visit.context.set_offline(True)
        return lambda: self.visit.context.set_offline(False)

    def set_clock(self) -> End:
        self.system.set_wall_clock("all", BACK)
        return lambda: self.system.set_wall_clock("all", 0.0)

    def set_clock_of_browser(self) -> End:
        self.visit.page.evaluate(SET_CLOCK, 1000 * BACK)
        return lambda: self.visit.page.evaluate(SET_CLOCK, 0)

    def stop(self) -> End:
        self.visit.page.click("#stop")
        return self._release

    def _release(self) -> None:
        self.visit.page.click("#release")
        self.visit.wait_text("#control-said", "bob may drive again")


def _serves(address: str) -> bool:
    with contextlib.suppress(OSError), urllib.request.urlopen(address, timeout=10):
        return True
    return False


class Fault(NamedTuple):
    """What breaks, and what the page says.

    :ivar strike: does it.
    :ivar says: what is in the headline then; empty: all goes on, and nothing wrong may be said.
    :ivar noticed: when.
    :ivar named: what the page has to name until the fault ends, in the headline or below it.
    """

    strike: Callable[[Scene], End]
    says: str
    noticed: Span = AT_ONCE
    named: str = ""
    variant: Variant = ONE

    def cell(self, lasts: float) -> str:
        """Whether the page says it when it lasts so long, s."""
        if not self.says:
            return "all goes on"
        if lasts <= self.noticed.earliest:
            return "too short"
        return "said" if lasts > self.noticed.latest else "may be said"


def hangs(node: str, called: str, noticed: Span = SILENCE, variant: Variant = ONE) -> Fault:
    named = called.rpartition(": ")[2]
    return Fault(lambda scene: scene.hang(node), f"{called} does not answer", noticed, named, variant)


def killed(node: str, called: str, noticed: Span = AT_ONCE) -> Fault:
    """Known by its connection; where there is none, by its silence."""
    says = f"{called} {'is gone' if noticed is AT_ONCE else 'does not answer'}"
    return Fault(lambda scene: scene.kill(node), says, noticed, called.rpartition(": ")[2])


NO_NEWS = "not known: no news since"
FAULTS: Dict[str, Fault] = {
    "navigation hangs": hangs("navigation", "not known: the navigation server"),
    "navigation is killed": killed("navigation", "not known: the navigation server"),
    "planning system hangs": hangs("planning_system", "the planning system"),
    "planning system is killed": killed("planning_system", "the planning system"),
    "Executor hangs": hangs("merlin_executor", "not known: the Executor"),
    "Executor is killed": killed("merlin_executor", "not known: the Executor"),
    "bridges hang": hangs("merlin_bridges", "the process of the bridges"),
    "bridges are killed": killed("merlin_bridges", "the process of the bridges", SILENCE),
    "state machines hang": hangs("merlin_fsm_host", "the process of the state machines"),
    "state machines are killed": killed("merlin_fsm_host", "the process of the state machines", SILENCE),
    "mission hangs": hangs("mission", "Round"),
    "mission is killed": killed("mission", "Round"),
    "simulator hangs": hangs("merlin_sim", "not known: the simulator"),
    "guard hangs": hangs("merlin_guard", "the velocity guard", UNWATCHED),
    "guard is killed": killed("merlin_guard", "the velocity guard", UNWATCHED),
    "monitor hangs": Fault(lambda scene: scene.hang("merlin_monitor"), NO_NEWS, STALLED, NO_NEWS),
    "monitor is killed": Fault(lambda scene: scene.kill("merlin_monitor"), NO_NEWS, AT_ONCE, NO_NEWS),
    "feed stalls": Fault(lambda scene: scene.stall(), NO_NEWS, STALLED, NO_NEWS),
    "browser is offline": Fault(lambda scene: scene.offline(), NO_NEWS, STALLED, NO_NEWS),
    "browser's clock is set back": Fault(lambda scene: scene.set_clock_of_browser(), ""),
    "master is killed": Fault(lambda scene: scene.kill_master(), ""),
    "computer's clock is set back": Fault(lambda scene: scene.set_clock(), "", variant=SET),
    "navigation of one of two robots hangs": hangs(
        "navigation", "not known: the navigation server", variant=TWO
    ),
    "both of two robots are stopped": Fault(
        lambda scene: scene.stop(), "bob stopped and held by chaos", STALLED, "stopped and held", TWO
    ),
}


def table() -> str:
    """What the page says, as the document has it."""
    rows = [["fault", "the headline", *(f"{lasts:.0f} s" for lasts in LASTS)], ["---"] * (2 + len(LASTS))]
    for name, fault in FAULTS.items():
        says = f"*{fault.says}*" if fault.says else ""
        rows.append([name, says, *(fault.cell(lasts) for lasts in LASTS)])
    return "".join(f"| {' | '.join(row)} |\n".replace("|  |", "| |") for row in rows)


def test_the_document_has_the_table_of_faults() -> None:
    assert table() in DOCUMENT.read_text(), table()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.fixture(scope="module")
def scene(request: pytest.FixtureRequest, browser: Any) -> Iterator[Scene]:
    scene = Scene(request.param, browser)
    yield scene
    scene.close()


@pytest.fixture(scope="module")
def seen() -> Iterator[List[str]]:
    lines: List[str] = []
    yield lines
    SEEN.parent.mkdir(parents=True, exist_ok=True)
    SEEN.write_text(
        "| fault | lasts, s | said after, s | well after, s |\n|---|---|---|---|\n" + "".join(lines)
    )


def lies(said: Dict[str, Any]) -> str:
    """In what the parts of the page contradict each other; empty: in nothing."""
    bad, doing = said["tone"] == "bad", said["doing"]
    unknown = doing.startswith("not known")
    wrong = {
        "title": said["title"] != f"{'⚠ ' * bad}{doing} – MERLIN",
        "icon": (said["icon"] == "icon-bad.svg") != bad,
        "state": (said["state"] == "Not known") != unknown or unknown and not bad,
        "what comes": bad and {said["next"], said["end"]} != {"–"},
        "progress": unknown and said["progress"] != "–",
        "time bar": ("no news" in doing) != ("no news" in said["time"]),
    }
    return ", ".join(name for name, is_wrong in wrong.items() if is_wrong)


CASES = [
    pytest.param(fault.variant, name, lasts, id=f"{name}, {lasts:.0f} s")
    for name, fault in FAULTS.items()
    for lasts in LASTS
]


@pytest.mark.long
@pytest.mark.processes
@pytest.mark.parametrize(("scene", "name", "lasts"), CASES, indirect=["scene"])
def test_the_headline_says_the_worst_truth(scene: Scene, name: str, lasts: float, seen: List[str]) -> None:
    fault, visit = FAULTS[name], scene.visit
    scene.wait_driving()
    begin = scene.now()
    end = fault.strike(scene)
    try:
        if fault.cell(lasts) == "said":
            visit.wait(SAID, [fault.says, begin], PATIENCE * fault.noticed.latest)
        visit.page.wait_for_timeout(1000 * max(0.0, begin + lasts - scene.now()))
    except AssertionError as error:
        raise AssertionError(f"{error}:\n{scene.text(begin)}") from None
    finally:
        ended = scene.now()
        end()
    scene.wait_driving()
    record, text = scene.record(begin), scene.text(begin)
    well = scene.now()
    found = [said["at"] for said in record if fault.says and fault.says in said["doing"]]
    after = f"{found[0] - begin:.1f}" if found else "–"
    seen.append(f"| {name} | {ended - begin:.1f} | {after} | {well - ended:.1f} |\n")
    wrong = [(lies(said), said) for said in record if lies(said)]
    assert not wrong, f"{wrong[0]}\n{text}"
    for said in record:
        if fault.says and found and found[0] <= said["at"] < ended:
            words = " ".join(said[each] for each in ("doing", "because", "trouble", "problem"))
            assert fault.named in words, f"{fault.named} is not named:\n{text}"
        if not fault.says and said["at"] < ended:
            assert said["tone"] != "bad" and not said["trouble"] and not said["grey"], text
    of_the_page = [each for each in visit.complaints if not OF_THE_NETWORK.search(each)]
    assert of_the_page == []
