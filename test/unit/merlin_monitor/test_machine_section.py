"""State machines as introspection shows them."""

import base64
import pickle
import queue
from typing import List, Tuple

from hypothesis import given
from hypothesis import strategies as st
from messages import Told, status, structure

from merlin_monitor.drawing.graph_layout import layout
from merlin_monitor.drawing.layout_thread import LayoutThread
from merlin_monitor.drawing.machine_graph import Graph, machine_graph, plan_graph
from merlin_monitor.state.machine_section import MachineSection, container_key
from merlin_monitor.state.state_tree import StateTree

OUTER = structure(
    "/M",
    ["A", "SUB"],
    [("ok", "A", "SUB"), ("bad", "A", "SUB"), ("no", "A", "None"), ("done", "SUB", "None")],
    ["no", "done"],
)
INNER = structure("/M/SUB", ["X"], [("ok", "X", "done")], ["done"])
KEY = container_key("/m", "/M")


def section() -> Tuple[StateTree, MachineSection, Told, List[str]]:
    tree, told = StateTree(), Told()
    pictures: List[str] = []
    return tree, MachineSection(tree, told, pictures.append), told, pictures


def test_a_nested_machine_runs() -> None:
    tree, machines, told, pictures = section()
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
    assert container["last"] == {"A": ["bad", "ok"]}, "SMACH does not tell which of the two it was"
    assert machines.active_leaf("m") == "M/SUB/X"
    machines.status("/m", status("/M", info="TERMINATED: done"), 3.0, 3.0)
    container = tree.get("machines", "containers", KEY)
    assert container["outcome"] == "done" and container["last"]["SUB"] == ["done"]
    assert told.texts == ["M: in A", "M: in SUB", "M: ended with done"]
    assert machines.active_leaf("m") == ""


def test_a_structure_that_is_being_taken_in_is_not_drawn_yet() -> None:
    tree, machines, _, _ = section()
    tree.set("machines", "containers", KEY, "path", "/M")
    tree.set("machines", "containers", KEY, "children", ["A"])
    assert machines.containers_below(KEY) == {}


def test_a_path_without_a_slash_is_drawn_too() -> None:
    _, machines, _, _ = section()
    machines.structure("/m", structure("SM_ROOT", ["A"], [("ok", "A", "None")], ["ok"]), 0.0)
    graph = machine_graph(machines.containers_below(container_key("/m", "SM_ROOT")), "SM_ROOT")
    assert [cluster.text for cluster in graph.clusters] == ["SM_ROOT"]


def test_a_machine_that_cannot_be_drawn_does_not_end_the_pictures() -> None:
    drawn: queue.Queue[tuple] = queue.Queue()
    layouts = LayoutThread(lambda *picture: drawn.put(picture))
    layouts.start()

    def broken() -> Graph:
        raise KeyError("outcomes")

    layouts.ask("broken", broken)
    layouts.ask("whole", lambda: plan_graph({"0": {"text": "(go)"}}, []))
    pictures = {
        name: (picture, reason) for name, picture, reason in (drawn.get(timeout=30), drawn.get(timeout=30))
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


def test_userdata_is_shown_and_bad_userdata_is_said() -> None:
    tree, machines, _, _ = section()
    data = base64.b64encode(pickle.dumps({"to": "kitchen"}, 2)).decode()
    machines.status("/m", status("/M", "A", data=data), 0.0, 0.0)
    assert tree.get("machines", "containers", KEY, "userdata") == [["to", "'kitchen'"]]
    machines.status("/m", status("/M", "A", data="rubbish!"), 0.0, 0.0)
    assert "no pickle" in tree.get("machines", "containers", KEY, "userdata_error")


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
    structure("/M/SUB", ["X"], [("a", "X", "X")], ["X"]),
]


@given(st.lists(st.sampled_from(MESSAGES), max_size=15))
def test_any_order_of_messages_and_any_names(messages: list) -> None:
    _, machines, _, _ = section()
    for message in messages:
        take = machines.structure if hasattr(message, "children") else machines.status
        take("/m", message, *([0.0] if take == machines.structure else [0.0, 0.0]))
        machines.active_leaf("m")
        containers = machines.containers_below(machines.root_of(KEY))
        if "/M" in containers:
            machine_graph(containers, "/M")


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
