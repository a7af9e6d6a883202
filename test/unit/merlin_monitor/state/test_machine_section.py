# SPDX-License-Identifier: Apache-2.0
"""State machines as introspection shows them."""

import base64
import pickle
import queue
from typing import Any, Dict, List, Tuple

import pytest
import rospy
from hypothesis import given
from hypothesis import strategies as st
from merlin_msgs.msg import StateOutcome
from messages import Reported, status, structure
from std_msgs.msg import Header

from merlin_monitor.drawing.graph_layout import DrawnGraph, LayoutThread, layout, machine_graph, plan_graph
from merlin_monitor.state.machine_section import (
    LONGEST_ROW,
    MOST_ROWS,
    MOST_STEPS,
    MachineSection,
    container_key,
)
from merlin_monitor.state.state_tree import StateTree
from merlin_monitor.text.phrase import in_english
from merlin_test import LONG

OUTER = structure(
    "/M",
    ["A", "SUB"],
    [("ok", "A", "SUB"), ("bad", "A", "SUB"), ("no", "A", "None"), ("done", "SUB", "None")],
    ["no", "done"],
)
INNER = structure("/M/SUB", ["X"], [("ok", "X", "done")], ["done"])
KEY = container_key("/m", "/M")


def section() -> Tuple[StateTree, MachineSection, Reported, List[str]]:
    tree, reported = StateTree(), Reported()
    pictures: List[str] = []
    return tree, MachineSection(tree, reported, pictures.append), reported, pictures


def test_a_nested_machine_runs() -> None:
    tree, machines, reported, pictures = section()
    machines.structure("/m", OUTER, 0.0)
    machines.structure("/m", INNER, 0.0)
    machines.structure("/m", INNER, 2.0)
    assert pictures == [KEY, KEY], "drawn when the structure is new, not at every heartbeat"
    machines.status("/m", status("/M", info="Initial state", initial="A"), 0.0, 0.0)
    machines.status("/m", status("/M", "A", info="START"), 1.0, 1.0)
    machines.status("/m", status("/M", "SUB", info="TRANSITION"), 2.0, 2.0)
    machines.status("/m", status("/M/SUB", "X", info="START"), 2.0, 2.0)
    container = tree.get("machines", "containers", KEY)
    assert container["active"] == ["SUB"]
    assert container["last"] == {"A": ["bad", "ok"]}, "SMACH does not publish which of the two it was"
    assert machines.active_leaf("m") == "M/SUB/X"
    machines.status("/m", status("/M", info="TERMINATED: done"), 3.0, 3.0)
    container = tree.get("machines", "containers", KEY)
    assert container["outcome"] == "done" and container["last"]["SUB"] == ["done"]
    assert reported.texts == ["M: in A", "M: in SUB", "M: ended with done"]
    assert machines.active_leaf("m") == ""


def test_a_structure_that_is_being_taken_in_is_not_drawn_yet() -> None:
    tree, machines, _, _ = section()
    tree.set("machines", "containers", KEY, "path", "/M")
    tree.set("machines", "containers", KEY, "children", ["A"])
    assert machines.containers_below(KEY) == {}


@pytest.mark.parametrize("first", ["structure", "status"])
def test_no_page_sees_a_part_of_a_new_container(monkeypatch: pytest.MonkeyPatch, first: str) -> None:
    tree, machines, _, _ = section()
    seen: List[bool] = []
    change = tree.put

    def changed(*path: str, **fields: Any) -> bool:  # a page may ask between any two
        done = change(*path, **fields)
        seen.append("path" in tree.get("machines", "containers", KEY, default={}))
        return done

    monkeypatch.setattr(tree, "put", changed)
    if first == "structure":
        machines.structure("/m", OUTER, 0.0)
    else:
        machines.status("/m", status("/M", "A"), 0.0, 0.0)
    assert seen and all(seen)


def test_a_path_without_a_slash_is_drawn_too() -> None:
    _, machines, _, _ = section()
    machines.structure("/m", structure("SM_ROOT", ["A"], [("ok", "A", "None")], ["ok"]), 0.0)
    graph = machine_graph(machines.containers_below(container_key("/m", "/SM_ROOT")), "/SM_ROOT")
    assert [cluster.text for cluster in graph.clusters] == ["SM_ROOT"]


def test_a_machine_that_cannot_be_drawn_does_not_end_the_pictures() -> None:
    drawn: queue.Queue[tuple] = queue.Queue()
    layouts = LayoutThread(lambda *picture: drawn.put(picture))
    layouts.start()

    def broken() -> DrawnGraph:
        raise KeyError("outcomes")

    layouts.ask("broken", broken)
    layouts.ask("whole", lambda: plan_graph({"0": "going"}, []))
    pictures = {
        name: (picture, reason)
        for name, picture, reason in (drawn.get(timeout=LONG), drawn.get(timeout=LONG))
    }
    layouts.stop()
    assert pictures["broken"] == (None, "KeyError: 'outcomes'")
    assert pictures["whole"][0] is not None


def test_machines_of_two_servers_with_one_path_stay_apart() -> None:
    tree, machines, _, _ = section()
    for server in ("/one", "/two"):
        machines.structure(server, OUTER, 0.0)
    machines.status("/one", status("/M", "A"), 0.0, 0.0)
    assert tree.get("machines", "containers", container_key("/two", "/M")).get("active") is None
    machines.server_gone("/one")
    assert tree.keys("machines", "containers") == [container_key("/two", "/M")]


def test_machines_of_two_nodes_with_one_server_and_path_stay_apart() -> None:
    tree, machines, _, _ = section()
    for node, state in (("/here", "A"), ("/there", "SUB")):
        machines.structure("/m", OUTER, 0.0, node)
        machines.structure("/m", INNER, 0.0, node)
        machines.status("/m", status("/M", state), 0.0, 0.0, node)
    here, there = (container_key("/m", "/M", node) for node in ("/here", "/there"))
    assert tree.get("machines", "containers", here, "active") == ["A"]
    assert tree.get("machines", "containers", there, "active") == ["SUB"]
    assert machines.root_of(container_key("/m", "/M/SUB", "/there")) == there
    machines.server_gone("/m", "/there")
    assert set(tree.keys("machines", "containers")) == {here, container_key("/m", "/M/SUB", "/here")}


@pytest.mark.parametrize("root", ["/", "SM_ROOT", "//SM_ROOT", "/SM/ROOT"])
@pytest.mark.parametrize("label", ["SUB", "[a/b]", "a:b"])
def test_a_container_is_inside_the_one_that_has_it_as_a_child(root: str, label: str) -> None:
    _, machines, reported, pictures = section()
    inner = f"{root.rstrip('/')}/{label}"
    machines.structure(
        "/m", structure(inner, ["X"], [("ok", "X", "None")], ["ok"]), 0.0
    )  # this may come first
    machines.structure("/m", structure(root, [label], [("ok", label, "None")], ["ok"]), 0.0)
    path = f"/{root.strip('/')}"
    key = container_key("/m", path)
    assert pictures[-1] == key
    assert machines.root_of(container_key("/m", f"/{inner.lstrip('/')}")) == key
    for state in ("", "X"):
        machines.status("/m", status(inner, *filter(None, [state])), 1.0, 1.0)
        machines.status("/m", status(root, *([label] if state else [])), 1.0, 1.0)
    name = path.strip("/")
    assert reported.texts == [f"{name or '/m'}: in {label}"], "of the machine, not of what is in it"
    graph = machine_graph(machines.containers_below(key), path)
    outer, within = graph.clusters
    assert (outer.text, within.text, within.parent) == (name.split("/")[-1] or "/", label, path)
    picture = layout(graph)
    assert {node["in"] for node in picture["nodes"]} == {path, within.id}
    assert {cluster["in"] for cluster in picture["clusters"]} == {"", path}


def test_silence_is_marked_but_not_while_the_simulation_is_paused() -> None:
    tree, machines, _, _ = section()
    machines.structure("/m", OUTER, 0.0)
    machines.check_silence(5.0, paused=False)
    assert not tree.get("machines", "containers", KEY, "silent")
    machines.check_silence(50.0, paused=True)
    assert not tree.get("machines", "containers", KEY, "silent")
    machines.check_silence(58.0, paused=False)
    assert tree.get("machines", "containers", KEY, "silent")
    machines.status("/m", status("/M"), 0.0, 60.0)
    assert not tree.get("machines", "containers", KEY, "silent")


def userdata(**values: Any) -> str:
    return base64.b64encode(pickle.dumps(values)).decode()


def test_each_executed_step_is_kept_with_what_it_changed_of_the_userdata() -> None:
    tree, machines, _, _ = section()
    machines.structure("/m", OUTER, 0.0)
    for run in range(2):
        machines.status(
            "/m", status("/M", info="Initial state", initial="A", data=userdata(to="hall")), 0.0, 0.0
        )
        machines.status("/m", status("/M", "A", data=userdata(to="hall")), 1.0, 1.0)
        assert tree.get("machines", "containers", KEY, "steps") == {}, run
        machines.status("/m", status("/M", "SUB", data=userdata(to="hall", said="a" * 500)), 2.0, 2.0)
        machines.status("/m", status("/M", "SUB", data=userdata(to="hall", said="a" * 500)), 2.5, 2.5)
        machines.status(
            "/m", status("/M", info="TERMINATED: done", data=userdata(to="dorm", said="a" * 500)), 3.0, 3.0
        )
        first, second = tree.get("machines", "containers", KEY, "steps").values()
        assert (first["state"], first["outcome"], first["at"]) == ("A", ["bad", "ok"], 2.0)
        (said, text), to = first["userdata"]
        assert (said, len(text), to) == ("said", LONGEST_ROW, ["to", "'hall'"])
        assert (second["state"], second["outcome"], second["userdata"]) == (
            "SUB",
            ["done"],
            [["to", "'dorm'"]],
        )


def test_of_a_long_run_the_newest_steps_are_kept() -> None:
    tree, machines, _, _ = section()
    machines.structure("/m", OUTER, 0.0)
    machines.status("/m", status("/M", info="Initial state", initial="A"), 0.0, 0.0)
    for number in range(2 * MOST_STEPS):
        data = userdata(**{f"key{each}": number for each in range(2 * MOST_ROWS)})
        machines.status("/m", status("/M", "A" if number % 2 else "SUB", data=data), float(number), 0.0)
    steps = tree.get("machines", "containers", KEY, "steps")
    assert len(steps) == MOST_STEPS
    assert max(map(int, steps)) == 2 * MOST_STEPS - 1, "the first state was entered from none"
    assert {len(step["userdata"]) for step in steps.values()} == {MOST_ROWS}


def test_userdata_is_shown_and_bad_userdata_is_said() -> None:
    tree, machines, _, _ = section()
    data = base64.b64encode(pickle.dumps({"to": "kitchen"}, 2)).decode()
    machines.status("/m", status("/M", "A", data=data), 0.0, 0.0)
    assert tree.get("machines", "containers", KEY, "userdata") == [["to", "'kitchen'"]]
    machines.status("/m", status("/M", "A", data="rubbish!"), 0.0, 0.0)
    assert "not a pickle" in tree.get("machines", "containers", KEY, "userdata_error")


MESSAGES = [
    OUTER,
    INNER,
    status("/M", "A"),
    status("/M", "SUB"),
    status("/M/SUB", "X"),
    status("/M"),
    status("/M", "GHOST"),
    structure("/M", ["<b>", '"', "A\n", "\\"], [("</text>", "<b>", '"'), ("x", "nowhere", "")], ["]]>"]),
    structure("", [], [], []),
    structure("/M", ["A"], [("lost", "A", "None"), ("ok", "A", "GHOST")], ["ok"]),
    structure("/M/SUB", ["X"], [("a", "X", "X")], ["X"]),
]


@given(st.lists(st.sampled_from(MESSAGES), max_size=15))
def test_any_order_of_messages_and_any_names(messages: list) -> None:
    tree, machines, _, _ = section()
    children: Dict[str, List[str]] = {}
    active: Dict[str, List[str]] = {}
    for message in messages:
        if hasattr(message, "children"):
            machines.structure("/m", message, 0.0)
            children[message.path or "/"] = message.children
        else:
            machines.status("/m", message, 0.0, 0.0)
            active[message.path] = [state for state in message.active_states if state != "None"]
        shown = tree.get("machines", "containers")
        assert shown.keys() == {container_key("/m", path) for path in (*children, *active)}
        for path in children:
            assert shown[container_key("/m", path)]["children"] == children[path]
        for path in active:
            assert shown[container_key("/m", path)]["active"] == active[path]
        outer = active.get("/M", [])
        inner = active.get("/M/SUB", []) if outer == ["SUB"] else []
        assert machines.active_leaf("m") == ("/".join(["M", *outer, *inner]) if outer else "")
        containers = machines.containers_below(machines.root_of(KEY))
        assert ("/M" in containers) is ("/M" in children)
        if "/M" in containers:
            graph = machine_graph(containers, "/M")
            drawn = {node.id for node in graph.nodes}
            assert all(f"/M/{child}" in drawn | containers.keys() for child in children["/M"])
            assert all({edge.tail, edge.head} <= drawn for edge in graph.edges)


def test_hostile_names_are_laid_out_and_come_back_as_they_were() -> None:
    _, machines, _, _ = section()
    names = ["<b>", '"', "a];b[label=x", "\\n", "ünï", "x" * 300]
    machines.structure("/m", structure("/M", names, [("o", name, "end") for name in names], ["end"]), 0.0)
    picture = layout(machine_graph(machines.containers_below(KEY), "/M"))
    assert {node["text"] for node in picture["nodes"]} == {*names, "end"}
    assert len(picture["edges"]) == len(names)
    for node in picture["nodes"]:
        assert 0 <= node["x"] <= picture["width"] and 0 <= node["y"] <= picture["height"]


def test_a_large_machine_whose_states_all_may_fail_is_laid_out_in_a_moment() -> None:
    _, machines, _, _ = section()
    names = [f"S{number}" for number in range(200)]
    edges = [("aborted", name, "aborted") for name in names]
    edges += [("succeeded", name, following) for name, following in zip(names, [*names[1:], "succeeded"])]
    machines.structure("/m", structure("/M", names, edges, ["succeeded", "aborted"]), 0.0)
    graph = machine_graph(machines.containers_below(KEY), "/M")
    assert len(graph.nodes) == 202
    assert {edge.head for edge in graph.edges} == {f"/M/{name}" for name in names[1:]} | {"/M:succeeded"}
    assert len(layout(graph)["nodes"]) == 202


def test_an_arrow_to_a_nested_machine_ends_at_its_frame() -> None:
    _, machines, _, _ = section()
    machines.structure("/m", OUTER, 0.0)
    machines.structure("/m", INNER, 0.0)
    graph = machine_graph(machines.containers_below(KEY), "/M")
    assert [(edge.tail, edge.head, edge.head_cluster, edge.text) for edge in graph.edges] == [
        ("/M/A", "/M/SUB/X", "/M/SUB", "bad, ok"),
        ("/M/A", "/M:no", "", ""),
        ("/M/SUB:done", "/M:done", "", ""),
        ("/M/SUB/X", "/M/SUB:done", "", "ok"),
    ]
    picture = layout(graph)
    assert {cluster["id"] for cluster in picture["clusters"]} == {"/M", "/M/SUB"}


def decided(
    state: str, outcome: str, ended: str, by: str = "Ana", at: float = 2.0, **fields: Any
) -> StateOutcome:
    header = Header(stamp=rospy.Time.from_sec(at))
    return StateOutcome(
        header, "/m_host", state, by, outcome, ended, fields.get("refused", ""), fields.get("unset", [])
    )


def test_executed_steps_show_what_an_operator_decided_whichever_is_heard_first() -> None:
    for first in (True, False):
        tree, machines, reported, _ = section()
        machines.structure("/m", OUTER, 0.0)
        machines.status("/m", status("/M", info="Initial state", initial="A"), 0.0, 0.0)
        machines.status("/m", status("/M", "A"), 1.0, 1.0)
        forced, other = decided("M/A", "bad", "preempted", unset=["found"]), decided("N/A", "ok", "preempted")
        for message in (other, *([forced] if first else [])):
            machines.outcome(message, 2.0)
        machines.status("/m", status("/M", "SUB"), 2.0, 2.0)
        if not first:
            machines.outcome(forced, 2.0)
        (step,) = tree.get("machines", "containers", KEY, "steps").values()
        assert (step["state"], step["outcome"], in_english(step["said"])) == ("A", ["bad"], "forced by Ana")
        assert "M/A left with bad, forced by Ana; nothing has set found" in reported.texts
        machines.status("/m", status("/M", info="TERMINATED: done"), 3.0, 3.0)
        assert "said" not in tree.get("machines", "containers", KEY, "steps", "2")


def test_steps_of_an_inner_machine_and_of_a_second_instance_are_marked_too() -> None:
    tree, machines, _, _ = section()
    inner, second = container_key("/m", "/M/SUB"), container_key("/m_2", "/M_2")
    for server, path, state in (("/m", "/M/SUB", "X"), ("/m_2", "/M_2", "A")):
        machines.structure(server, structure(path, [state], [("ok", state, "None")], ["ok"]), 0.0)
        machines.status(server, status(path, state), 1.0, 1.0)
        machines.outcome(decided(f"M{'/SUB' if server == '/m' else ''}/{state}", "ok", "ok"), 2.0)
        machines.status(server, status(path, info="TERMINATED: ok"), 2.0, 2.0)
    for key in (inner, second):
        (step,) = tree.get("machines", "containers", key, "steps").values()
        assert in_english(step["said"]) == "confirmed by Ana"


def test_what_operators_decide_is_reported() -> None:
    _, machines, reported, _ = section()
    machines.outcome(decided("M/A", "ok", "ok"), 2.0)
    machines.outcome(decided("M/A", "ok", "bad", refused="/base did not stop"), 2.0)
    machines.outcome(decided("M/A", "ok", "ok", by=""), 2.0)
    assert reported.texts == [
        "M/A left with ok, confirmed by Ana",
        "Ana wished ok of M/A, which did not come true: /base did not stop",
        "M/A left with ok, not confirmed: there was no console",
    ]
