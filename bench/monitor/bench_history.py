# SPDX-License-Identifier: Apache-2.0
"""A history of 100 000 events and of ten minutes in which much was shown: its size, and how soon any moment
of it is in the page, in Chromium; and what it costs to make one of a bag.
"""

import random
import tempfile
import time
from pathlib import Path
from typing import Any, Dict

import genpy
import rosbag
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from measuring.figures import figure
from merlin_msgs.msg import KnowledgeChanges
from rosplan_knowledge_msgs.msg import KnowledgeItem
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from merlin_monitor.bag import KNOWLEDGE, PARAMETERS
from merlin_monitor.bag.bag_import import import_bag
from merlin_monitor.bag.recording import BagRecording
from merlin_monitor.state.history_events import Event
from merlin_monitor.state.history_store import Frames, HistoryStore
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.web.open_command import opened
from merlin_test.chromium import Visit, chromium

EVENTS = 100_000
FACTS = 10_000
MINUTES = 10
RATE = 100  # changes of facts per s
FRAMES = 5  # per s
JUMPS = 50
LIMIT = 120.0  # s
BAG_MINUTES = 6.0
BAG_TRANSFORMS = 20  # per s
PARTS = 13  # that report once per s
SHOWN = ("now", "plan", "queue", "map", "knowledge", "history")

# Goes to a moment, and says after how many ms it is drawn.
_JUMP = """(hash) => new Promise((done) => {
  const begin = performance.now();
  const target = document.getElementById("now-doing");
  new MutationObserver((_, observer) => {
    observer.disconnect();
    requestAnimationFrame(() => {
      const channel = new MessageChannel();
      channel.port1.onmessage = () => done(performance.now() - begin);
      channel.port2.postMessage(0);
    });
  }).observe(target, { childList: true, characterData: true, subtree: true });
  location.hash = hash;
})"""


class Clock:
    """Time that continues by a call."""

    def __init__(self) -> None:
        self.at = time.time() - 60.0 * MINUTES

    def __call__(self) -> float:
        return round(self.at, 3)


def write(path: Path) -> float:
    """Records; returns the s that making frames took."""
    tree = StateTree()
    clock = Clock()
    store = HistoryStore(path, EVENTS, clock=clock)
    panels = [
        {"name": name, "title": name, "width": 6, "script": f"package://merlin_monitor/web/panels/{name}.js"}
        for name in SHOWN
    ]
    tree.set("meta", "panels", panels)
    tree.set(
        "knowledge", "facts", {f"(on thing{n} shelf{n % 50})": {"by": "/x", "at": 0.0} for n in range(FACTS)}
    )
    frames_of = Frames(tree, clock, lambda: None)  # apart from the store, to be measured
    store.follow(tree, live=False)  # the time is ours
    computed = 0.0
    frames = MINUTES * 60 * FRAMES
    for frame in range(frames):
        clock.at += 1.0 / FRAMES
        tree.set("meta", "time", round(frame / FRAMES, 1))
        tree.set("now", "said", {"doing": f"doing {frame}"})
        tree.set("map", "robot", [round(random.uniform(0, 9), 3), round(random.uniform(0, 9), 3), 0.1])
        for _ in range(RATE // FRAMES):
            number = random.randrange(FACTS)
            tree.set(
                "knowledge", "facts", f"(on thing{number} shelf{number % 50})", {"by": "/y", "at": clock()}
            )
        for number in range(EVENTS // frames + 1):
            mark = "failure" if number == 0 and frame % 20 == 0 else ""
            store.add(
                Event(
                    "action",
                    f"(put thing{number} shelf{frame % 50}) succeeded after 3.1 s",
                    clock(),
                    {},
                    mark,
                )
            )
        begin = time.thread_time()
        frames_of.next(marked=True)
        computed += time.thread_time() - begin
        store.take()
    store.close()
    return computed


def record(path: Path) -> None:
    """A bag of a robot that drives, reports, and changes what it knows."""
    parts = [DiagnosticStatus(name=f"node{number}: life", message="well") for number in range(PARTS)]
    transform = TransformStamped(child_frame_id="base_footprint")
    transform.header.frame_id, transform.transform.rotation.w = "map", 1.0
    begin = time.time()
    with rosbag.Bag(str(path), "w", compression="lz4") as target:

        def tell(topic: str, message: Any, at: float) -> None:
            target.write(topic, message, genpy.Time.from_sec(at))

        tell(f"/{PARAMETERS}", String("{}"), begin)
        tell(f"/{KNOWLEDGE}", KnowledgeChanges(cleared=True), begin)
        for tick in range(int(BAG_MINUTES * 60 * BAG_TRANSFORMS)):
            at = begin + tick / BAG_TRANSFORMS
            transform.header.stamp = genpy.Time.from_sec(at)
            transform.transform.translation.x = tick % 500 / 50
            tell("/tf", TFMessage([transform]), at)
            if tick % BAG_TRANSFORMS:
                continue
            for part in parts:
                tell("/diagnostics", DiagnosticArray(status=[part]), at)
            fact = KnowledgeItem(knowledge_type=KnowledgeItem.FACT, attribute_name=f"fact{tick % 7}")
            change = KnowledgeChanges(added=[fact], client="/node1")
            change.header.stamp = transform.header.stamp
            tell("/rosplan_knowledge_base/changes", change, at)


def bag() -> Dict[str, float]:
    """What an hour of a bag costs."""
    hour = 60.0 / BAG_MINUTES
    with tempfile.TemporaryDirectory(prefix="bench_bag_") as folder:
        source, target = Path(folder) / "run.bag", Path(folder) / "history.sqlite"
        record(source)
        begin = time.monotonic()
        import_bag(BagRecording(source), target)
        return {
            "history_of_an_hour_of_a_bag_s": round((time.monotonic() - begin) * hour, 1),
            "history_of_an_hour_of_a_bag_mb": round(target.stat().st_size / 1e6 * hour, 2),
            "history_bag_mb_per_hour": round(source.stat().st_size / 1e6 * hour, 1),
        }


def measure() -> Dict[str, Any]:
    """Keys: history_*."""
    with tempfile.TemporaryDirectory(prefix="bench_history_") as folder:
        path = Path(folder) / "history.sqlite"
        computed = write(path)
        began = time.monotonic()
        with opened(path, "127.0.0.1", 0) as server, chromium() as browser:
            serving = time.monotonic() - began
            begin = time.monotonic()
            visit = Visit(browser, server.address)
            visit.wait(
                "() => document.getElementById('now-doing').textContent.startsWith('Doing')"
                " || document.getElementById('now-doing').textContent.startsWith('doing')",
                limit=LIMIT,
            )
            visit.wait("() => document.querySelectorAll('#history-list .event').length > 100", limit=LIMIT)
            page = time.monotonic() - begin
            runs = visit.page.evaluate("async () => (await fetch('/past/runs')).json()")
            (run,) = runs
            jumps = []
            for _ in range(JUMPS):
                wall = random.uniform(run["began"], run["ended"])
                jumps.append(visit.page.evaluate(_JUMP, f"#moment={run['run']}@{wall:.3f}"))
            complaints = visit.complaints
            visit.close()
    if complaints:
        raise RuntimeError(f"the page complained: {complaints[:3]}")
    return {
        **bag(),
        "history_events": EVENTS,
        "history_open_s": round(serving + page, 2),
        "history_jump_ms": figure(jumps),
        "history_jump_max_ms": round(max(jumps), 1),
        "history_megabytes_per_hour": round(run["bytes"] / 1e6 * 60 / MINUTES, 1),
        "history_recorder_percent_of_a_core": round(100.0 * computed / (60.0 * MINUTES), 2),
    }
