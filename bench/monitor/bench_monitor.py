# SPDX-License-Identifier: Apache-2.0
"""From a change in ROS to the page that shows it, in Chromium, and what that costs: a machine of 200 states,
10 000 facts, 100 changes a second. The history is recorded meanwhile.
"""

import os
import sqlite3
import threading
import time
from pathlib import Path
from typing import Any, Dict, List, Tuple

import rospy
from measuring.figures import figure
from measuring.process_tree import processor
from measuring.ros_process import RosMaster
from planning.bench_knowledge import ADD, DOMAIN, KB, REMOVE, Shelves, fact, instance

import smach
import smach_ros
from merlin_test.chromium import Visit, chromium

STATES = 200
FACTS = 10_000
FACT_RATE = 80.0  # changes per s
STATE_RATE = 20.0  # transitions per s
WARM_UP = 3.0  # s
DURATION = 20.0  # s
LIMIT = 120.0  # s for the page to show everything
SHELVES = 60  # each fact that is added is another one: 40 shelves times 1 000 things, taken in turn

# Notes when the page has shown what it says: after the frame that draws a change of its elements.
_WATCH = """() => {
  const seen = window.seen = { facts: [], states: [], frames: [] };
  const now = () => (performance.timeOrigin + performance.now()) / 1000;
  const shown = (list, what) => requestAnimationFrame(() => {
    const channel = new MessageChannel();
    channel.port1.onmessage = () => list.push([what, now()]);
    channel.port2.postMessage(0);
  });
  new MutationObserver((records) => {
    for (const { addedNodes } of records) for (const row of addedNodes) {
      const part = (name) => row.querySelector(`:scope .${name}`);
      shown(seen.facts, `${part("glyph").textContent} ${part("text").title}`);
    }
  }).observe(document.getElementById("knowledge-recent"), { childList: true });
  new MutationObserver((records) => {
    for (const { target } of records) {
      if (target.matches(".node.active")) shown(seen.states, target.querySelector("title").textContent);
    }
  }).observe(document.getElementById("machine-list"), { attributeFilter: ["class"], subtree: true });
  const frame = (at) => { seen.frames.push(at); requestAnimationFrame(frame); };
  requestAnimationFrame(frame);
}"""


class Step(smach.State):
    """Waits a moment, and notes when it lets the next state begin."""

    def __init__(self, following: str, reported: List[Tuple[str, float]], stop: threading.Event) -> None:
        smach.State.__init__(self, outcomes=["done", "stopped"])
        self._following, self._reported, self._stop = following, reported, stop

    def execute(self, ud: Any) -> str:
        if self._stop.wait(1.0 / STATE_RATE):
            return "stopped"
        self._reported.append((self._following, time.time()))
        return "done"


def ring(reported: List[Tuple[str, float]], stop: threading.Event) -> smach.StateMachine:
    """200 states, one after the other, over and over."""
    machine = smach.StateMachine(outcomes=["stopped"])
    with machine:
        for number in range(STATES):
            following = f"STATE_{(number + 1) % STATES}"
            smach.StateMachine.add(
                f"STATE_{number}",
                Step(following, reported, stop),
                transitions={"done": following, "stopped": "stopped"},
            )
    return machine


def change_facts(shelves: Shelves, reported: List[Tuple[str, float]], stop: threading.Event) -> None:
    """Adds facts and takes them away again, at an even pace."""
    begin = time.monotonic()
    number = 0
    while not stop.wait(max(0.0, begin + number / FACT_RATE - time.monotonic())):
        turn = number // 2
        thing, shelf = f"t{turn % Shelves.THINGS}", f"s{FACTS // Shelves.THINGS + 2 + turn // Shelves.THINGS}"
        sign, kind = ("+", ADD) if number % 2 == 0 else ("−", REMOVE)
        reported.append((f"{sign} (on {thing} {shelf})", time.time()))
        if not shelves.update(kind, fact("on", thing, shelf)).success:
            raise RuntimeError("the knowledge base refused a fact")
        number += 1


def latencies_ms(reported: List[Tuple[str, float]], seen: List[List[Any]]) -> Tuple[List[float], int]:
    """ms from each change to the page that shows it, or what came after it; and how many were never shown."""
    places: Dict[str, List[int]] = {}
    for place, (what, _) in enumerate(reported):
        places.setdefault(what, []).append(place)
    shown: Dict[int, float] = {}
    for what, at in seen:
        before = [place for place in places.get(what, []) if reported[place][1] <= at]
        if before:
            shown.setdefault(before[-1], at)
    samples: List[float] = []
    at = float("inf")
    for place in reversed(range(len(reported))):
        at = min(at, shown.get(place, at))
        if at < float("inf"):
            samples.append(1000.0 * (at - reported[place][1]))
    return samples, len(reported) - len(shown)


def browser_pids() -> List[int]:
    """Processes of the browser that this one has started."""
    parents, browsers = {}, []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(folder.name)] = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
            if "chromium" in os.readlink(folder / "exe"):
                browsers.append(int(folder.name))
        except (OSError, IndexError):
            continue

    def ours(pid: int) -> bool:
        while pid > 1 and pid != os.getpid():
            pid = parents.get(pid, 0)
        return pid == os.getpid()

    return [pid for pid in browsers if ours(pid)]


def kept_bytes(history: Path) -> int:
    """What the monitor's history has kept of what was shown."""
    connection = sqlite3.connect(f"file:{history}?mode=ro", uri=True, timeout=LIMIT)
    try:
        return int(connection.execute("SELECT TOTAL(bytes) FROM segments").fetchone()[0])
    finally:
        connection.close()


def measure() -> Dict[str, Any]:
    """Keys: monitor_*."""
    facts: List[Tuple[str, float]] = []
    states: List[Tuple[str, float]] = []
    stop = threading.Event()
    with RosMaster() as master:
        domain = Path(os.environ["ROS_LOG_DIR"]) / "shelves.pddl"
        domain.write_text(DOMAIN)
        master.node("merlin_rosplan", "knowledge_base", KB, {"domain_path": str(domain)})
        master.wait_for_service(f"/{KB}/update_array")
        rospy.init_node("bench_monitor", disable_signals=True)
        shelves = Shelves()
        shelves.start()
        shelves.grow(FACTS)
        shelves.send([instance("shelf", f"s{number}") for number in range(FACTS // Shelves.THINGS, SHELVES)])
        machine = ring(states, stop)
        server = smach_ros.IntrospectionServer("ring", machine, "/RING")
        server.start()
        history = Path(os.environ["ROS_LOG_DIR"]) / "history.sqlite"
        monitor = master.node(
            "merlin_monitor", "monitor", "merlin_monitor", {"port": 0, "history": str(history)}
        )
        end = time.monotonic() + LIMIT
        while not rospy.has_param("/merlin_monitor/address"):
            if time.monotonic() > end:
                raise RuntimeError(f"the monitor does not start: {master.output('merlin_monitor')}")
            time.sleep(0.05)
        threads = [
            threading.Thread(target=machine.execute, name="machine", daemon=True),
            threading.Thread(target=change_facts, args=(shelves, facts, stop), name="facts", daemon=True),
        ]
        threads[0].start()  # the page folds a machine that does not run
        with chromium() as browser:
            opened = time.monotonic()
            visit = Visit(browser, rospy.get_param("/merlin_monitor/address"))
            visit.wait(
                "([facts, states]) => document.querySelectorAll('.node.state').length === states"
                " && document.querySelectorAll('#kinds button')[1].textContent === `Facts ${facts}`",
                [FACTS, STATES],
                LIMIT,
            )
            shown = time.monotonic() - opened
            threads[1].start()
            time.sleep(WARM_UP)
            visit.page.evaluate(_WATCH)
            skipped = len(facts), len(states)
            pids = browser_pids()
            cpu = sum(processor([monitor.pid]).values()), sum(processor(pids).values())
            kept = kept_bytes(history)
            begin = time.monotonic()
            time.sleep(DURATION)
            wall = time.monotonic() - begin
            kept = kept_bytes(history) - kept
            monitor_share = 100.0 * (sum(processor([monitor.pid]).values()) - cpu[0]) / wall
            browser_share = 100.0 * (sum(processor(pids).values()) - cpu[1]) / wall
            changes = len(facts) - skipped[0] + len(states) - skipped[1]
            stop.set()
            for thread in threads:
                thread.join(10.0)
            time.sleep(1.0)
            seen = visit.page.evaluate("() => window.seen")
            complaints = visit.complaints
            visit.close()
        server.stop()
    if complaints:
        raise RuntimeError(f"the page complained: {complaints[:3]}")
    fact_ms, facts_unseen = latencies_ms(facts[skipped[0] :], seen["facts"])
    state_ms, states_unseen = latencies_ms(states[skipped[1] :], seen["states"])
    frames = [b - a for a, b in zip(seen["frames"], seen["frames"][1:])]
    return {
        "monitor_change_to_visible_ms": figure(fact_ms + state_ms),
        "monitor_fact_to_visible_ms": figure(fact_ms),
        "monitor_state_to_visible_ms": figure(state_ms),
        "monitor_never_shown": {"facts": facts_unseen, "states": states_unseen},
        "monitor_changes_per_s": round(changes / wall, 1),
        "monitor_history_megabytes_per_hour": round(kept / 1e6 * 3600.0 / wall, 1),
        "monitor_frame_ms": figure(frames),
        "monitor_open_s": round(shown, 2),
        "monitor_cpu_percent_of_a_core": {
            "monitor": round(monitor_share, 1),
            "chromium": round(browser_share, 1),
        },
    }
