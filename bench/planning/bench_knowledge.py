# SPDX-License-Identifier: Apache-2.0
"""What the knowledge base and the problem interface cost an ordinary rospy client, over ROS."""

import tempfile
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any, Dict, List

import rospy
from diagnostic_msgs.msg import KeyValue
from measuring.figures import figure, time_ms
from measuring.ros_process import RosMaster
from rosplan_dispatch_msgs.srv import ProblemService
from rosplan_knowledge_msgs.msg import KnowledgeItem
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    KnowledgeQueryService,
    KnowledgeUpdateService,
    KnowledgeUpdateServiceArray,
)
from std_srvs.srv import Empty

HOME = Path(__file__).resolve().parents[2] / "pddl" / "home"
KB = "rosplan_knowledge_base"
SIZES = (10, 1_000, 10_000, 100_000)
BATCH = 500  # items in one array
ADD, ADD_GOAL, REMOVE, REMOVE_GOAL = 0, 1, 2, 3
DOMAIN = """(define (domain shelves) (:requirements :strips :typing)
  (:types thing shelf) (:predicates (on ?t - thing ?s - shelf) (seen ?t - thing))
  (:action look :parameters (?t - thing) :effect (seen ?t)))"""


def fact(name: str, *args: str) -> KnowledgeItem:
    return KnowledgeItem(
        knowledge_type=KnowledgeItem.FACT,
        attribute_name=name,
        values=[KeyValue(str(number), arg) for number, arg in enumerate(args)],
    )


def instance(kind: str, name: str) -> KnowledgeItem:
    return KnowledgeItem(knowledge_type=KnowledgeItem.INSTANCE, instance_type=kind, instance_name=name)


def proxy(name: str, service_class: Any, node: str = KB) -> rospy.ServiceProxy:
    return rospy.ServiceProxy(f"/{node}/{name}", service_class, persistent=True)


class Shelves:
    """A knowledge base that grows: every fact puts one of 1 000 things on one of many shelves."""

    THINGS = 1_000

    def __init__(self) -> None:
        self.update = proxy("update", KnowledgeUpdateService)
        self.update_array = proxy("update_array", KnowledgeUpdateServiceArray)
        self.query = proxy("query_state", KnowledgeQueryService)
        self.propositions = proxy("state/propositions", GetAttributeService)
        self.clear = proxy("clear", Empty)
        self.facts = 0
        self._shelves = 0

    def send(self, items: List[KnowledgeItem], kind: int = ADD) -> None:
        for start in range(0, len(items), BATCH):
            part = items[start : start + BATCH]
            if not self.update_array([kind] * len(part), part).success:
                raise RuntimeError("the knowledge base refused what the benchmark sent")

    def start(self) -> None:
        self.clear()
        self.facts = self._shelves = 0
        self.send([instance("thing", f"t{number}") for number in range(self.THINGS)])

    def grow(self, size: int) -> None:
        shelves = size // self.THINGS + 2
        self.send([instance("shelf", f"s{number}") for number in range(self._shelves, shelves)])
        self._shelves = shelves
        self.send([self.fact(number) for number in range(self.facts, size)])
        self.facts = size

    def fact(self, number: int) -> KnowledgeItem:
        return fact("on", f"t{number % self.THINGS}", f"s{number // self.THINGS}")

    def change_one(self) -> None:
        """A fact is added and taken away again: two updates."""
        item = fact("seen", "t7")
        assert self.update(ADD, item).success and self.update(REMOVE, item).success


def load_10000() -> List[float]:
    """Seconds to load 10 000 facts in arrays of 500 into an empty knowledge base."""
    samples = []
    shelves = Shelves()
    for _ in range(5):
        shelves.start()
        shelves.grow(0)
        shelves.send([instance("shelf", f"s{number}") for number in range(2, 12)])
        items = [shelves.fact(number) for number in range(10_000)]
        start = time.perf_counter()
        shelves.send(items)
        samples.append(time.perf_counter() - start)
    return samples


def clients_at_once(count: int) -> Dict[str, float]:
    """ms of one query while `count` clients ask at the same time, each over its own connection."""
    samples: List[float] = []

    def ask() -> None:
        query = proxy("query_state", KnowledgeQueryService)
        item = fact("on", "t7", "s0")
        query([item])
        own = []
        for _ in range(200):
            start = time.perf_counter()
            query([item])
            own.append((time.perf_counter() - start) * 1000.0)
        samples.extend(own)
        query.close()

    threads = [threading.Thread(target=ask) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return figure(samples)


def measure_sizes(results: Dict[str, Any]) -> None:
    keys = (
        "kb_update_ms",
        "kb_query_ms",
        "kb_wildcard_query_ms",
        "kb_propositions_ms",
        "problem_by_facts_ms",
    )
    results.update({key: {} for key in keys})
    generate = proxy("problem_generation_server_params", ProblemService, "shelves_problem_interface")
    shelves = Shelves()
    shelves.start()
    shelves.send([fact("seen", f"t{number}") for number in range(1_000)], ADD_GOAL)
    for size in SIZES:
        shelves.grow(size)
        pair = time_ms(shelves.change_one, 500)
        results["kb_update_ms"][str(size)] = {
            key: value if key == "n" else round(value / 2, 4) for key, value in pair.items()
        }
        known = shelves.fact(size // 2)
        results["kb_query_ms"][str(size)] = time_ms(partial(shelves.query, [known]), 1000)
        wildcard = fact("on", "", known.values[1].value)
        results["kb_wildcard_query_ms"][str(size)] = time_ms(partial(shelves.query, [wildcard]), 300)
        results["problem_by_facts_ms"][str(size)] = time_ms(lambda: generate("", False), 10, warm_up=1)
        repeats = 200 if size <= 1_000 else 10 if size <= 10_000 else 3
        results["kb_propositions_ms"][str(size)] = time_ms(
            lambda: shelves.propositions("on"), repeats, warm_up=1
        )


def measure_goals(results: Dict[str, Any]) -> None:
    """A thousand goals, added and removed by two arrays, and listed while they stand."""
    shelves = Shelves()
    shelves.start()
    goals = [fact("seen", f"t{number}") for number in range(1_000)]

    def change() -> None:
        shelves.send(goals, ADD_GOAL)
        shelves.send(goals, REMOVE_GOAL)

    results["kb_goals_1000_change_ms"] = time_ms(change, 20, warm_up=1)
    shelves.send(goals, ADD_GOAL)
    listed = proxy("state/goals", GetAttributeService)
    results["kb_goals_1000_list_ms"] = time_ms(lambda: listed(""), 20, warm_up=1)


def measure_problem(results: Dict[str, Any]) -> None:
    """The problem of the home, by a problem interface in the knowledge base's process and in its own."""
    update = proxy("update", KnowledgeUpdateService, "home_knowledge_base")
    assert update(ADD_GOAL, fact("checked", "kitchen")).success
    for key, node in (
        ("problem_ms", "rosplan_problem_interface"),
        ("problem_own_process_ms", "problem_apart"),
    ):
        generate = proxy("problem_generation_server_params", ProblemService, node)
        results[key] = time_ms(partial(generate, "", True), 200)


def measure() -> Dict[str, Any]:
    results: Dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, RosMaster() as master:
        domain = Path(folder) / "shelves.pddl"
        domain.write_text(DOMAIN)
        kept = {"domain_path": str(domain), "state_file": str(Path(folder) / "state.sqlite")}
        master.node("merlin_rosplan", "knowledge_base", "kept_knowledge_base", kept)
        components = {
            KB: "knowledge_base",
            "shelves_problem_interface": "problem_interface",
            "home_knowledge_base": "knowledge_base",
            "rosplan_problem_interface": "problem_interface",
        }
        master.set_params(
            {
                f"/{KB}/domain_path": str(domain),
                "/home_knowledge_base/domain_path": str(HOME / "domain.pddl"),
                "/home_knowledge_base/problem_path": str(HOME / "problem.pddl"),
                "/rosplan_problem_interface/knowledge_base": "home_knowledge_base",
            }
        )
        master.node("merlin_rosplan", "planning_system", "planning_system", {"components": components})
        apart = {"knowledge_base": "home_knowledge_base"}
        master.node("merlin_rosplan", "problem_interface", "problem_apart", apart)
        for service in (
            f"/{KB}/apply_effects",
            "/kept_knowledge_base/apply_effects",
            "/rosplan_problem_interface/problem_generation_server_params",
            "/shelves_problem_interface/problem_generation_server_params",
            "/problem_apart/problem_generation_server_params",
        ):
            master.wait_for_service(service)
        rospy.init_node("bench_knowledge", disable_signals=True)
        measure_problem(results)
        results["kb_load_10000_s"] = figure(load_10000())
        measure_goals(results)
        measure_sizes(results)
        results["kb_query_8_clients_ms"] = clients_at_once(8)
        kept_update = proxy("update", KnowledgeUpdateService, "kept_knowledge_base")
        assert kept_update(ADD, instance("thing", "t7")).success

        def change() -> None:
            assert kept_update(ADD, fact("seen", "t7")).success
            assert kept_update(REMOVE, fact("seen", "t7")).success

        pair = time_ms(change, 300)
        results["kb_update_kept_ms"] = {
            key: value if key == "n" else round(value / 2, 4) for key, value in pair.items()
        }
    return results
