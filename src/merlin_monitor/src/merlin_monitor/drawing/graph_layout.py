# SPDX-License-Identifier: Apache-2.0
"""Geometry of graphs by Graphviz, for which no caller waits. The texts stay here: it sees sizes only."""

import json
import subprocess
from collections import Counter
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

from merlin_ros.work.threads import CallQueue, failure_text

SMALL, LARGE = 7.0, 8.2  # px of a character of an edge's and a node's text
CROWD = 25  # states with an arrow to the same outcome, beyond which these arrows are left out


class DrawnNode(NamedTuple):
    """A box: its name in the state, its text, its kind (state, outcome, step), and the cluster it is in."""

    id: str
    text: str
    kind: str
    cluster: str = ""


class DrawnEdge(NamedTuple):
    """An arrow; `head_cluster` is what it points at as a whole, if not only at `head`."""

    tail: str
    head: str
    text: str = ""
    head_cluster: str = ""


class Cluster(NamedTuple):
    """A frame around nodes: a container."""

    id: str
    text: str
    parent: str = ""


class DrawnGraph(NamedTuple):
    """A picture to be laid out; `direction` as Graphviz names it: TB, LR."""

    nodes: List[DrawnNode]
    edges: List[DrawnEdge]
    clusters: List[Cluster] = []
    direction: str = "TB"


def inside(path: str, label: str) -> str:
    """The path of a state or container in a container, which may be called ``/``."""
    return f"/{label}" if path == "/" else f"{path}/{label}"


def machine_graph(containers: Dict[str, Dict[str, Any]], root: str) -> DrawnGraph:
    """The picture of a machine with the containers in it.

    Where most states of a large machine may end with the same outcome, its arrows would hide all others
    and take Graphviz minutes; that outcome stands alone then.

    :param containers: by path: children, edges, outcomes, initial.
    :param root: path of the outermost one.
    """
    nodes: List[DrawnNode] = []
    edges: List[DrawnEdge] = []
    clusters: List[Cluster] = []
    # A label may have slashes: what is inside what is known by the children only.
    places = {
        inside(path, child): (child, path)
        for path, container in containers.items()
        for child in container["children"]
    }
    for path, container in containers.items():
        top = (path.rsplit("/", 1)[-1] or path, "")
        clusters.append(Cluster(path, *(top if path == root else places.get(path, top))))
        nodes += [
            DrawnNode(inside(path, child), child, "state", path)
            for child in container["children"]
            if inside(path, child) not in containers
        ]
        outcomes = set(container["outcomes"])
        nodes += [DrawnNode(f"{path}:{outcome}", outcome, "outcome", path) for outcome in sorted(outcomes)]
        grouped: Dict[Tuple[str, str], List[str]] = {}
        for outcome, source, target in container["edges"]:
            end = target or outcome
            if source not in container["children"]:
                continue
            if end in container["children"] and target:
                head = inside(path, end)
            elif end in outcomes:
                head = f"{path}:{end}"
            else:
                continue
            # Of a container, the edge begins at the outcome inside it.
            inner = containers.get(inside(path, source))
            if inner is not None:
                tail = f"{inside(path, source)}:{outcome}"
                if outcome not in inner["outcomes"]:
                    continue
                grouped.setdefault((tail, head), [])
            else:
                label = [] if head == f"{path}:{outcome}" else [outcome]
                grouped.setdefault((inside(path, source), head), []).extend(label)
        arrows = Counter(head for _, head in grouped)
        for (tail, head), texts in grouped.items():
            if arrows[head] > CROWD and head.startswith(f"{path}:"):
                continue
            entry, whole = _entry(containers, head)
            if entry is not None:
                edges.append(DrawnEdge(tail, entry, ", ".join(sorted(set(texts))), whole))
    return DrawnGraph(nodes, edges, clusters)


def plan_graph(steps: Dict[str, str], edges: List[List[str]]) -> DrawnGraph:
    """The picture of a plan.

    :param steps: their words by their keys.
    """
    nodes = [DrawnNode(key, words, "step") for key, words in steps.items()]
    return DrawnGraph(nodes, [DrawnEdge(before, after) for before, after in edges], direction="LR")


def _entry(containers: Dict[str, Dict[str, Any]], head: str) -> Tuple[Optional[str], str]:
    """The node at which an arrow to a state arrives: of a container its first state."""
    whole = ""
    for _ in range(20):
        container = containers.get(head)
        if container is None:
            return head, whole
        whole = whole or head
        initial = [state for state in container.get("initial", []) if state in container["children"]]
        first = initial or list(container["children"])
        if not first:
            return None, ""
        head = inside(head, first[0])
    return None, ""


CAREFUL = 6.0  # s of wall time for the picture as it should be
TIMEOUT = 20.0  # s of wall time for one that is drawn in a hurry
HURRY = ("-Gsplines=line", "-Gnslimit=1", "-Gnslimit1=1", "-Gmclimit=0.1")
LONGEST_LABEL = 34  # characters; the page cuts what is longer
_POINTS = 72.0  # per inch
_HEIGHT = {"state": 34, "step": 34, "outcome": 24}  # px
_PADDING = {"state": 34, "step": 30, "outcome": 22}  # px
Done = Callable[[str, Optional[Dict[str, Any]], str], None]


class LayoutError(RuntimeError):
    """The graph cannot be drawn; the text says why."""


def layout(graph: DrawnGraph) -> Dict[str, Any]:
    """Lays a graph out.

    :return: width and height (px), nodes with their centres and sizes, clusters with their frames, edges with
        the points of their Bézier curves.
    :raises LayoutError: Graphviz is missing, failed or took too long.
    """
    source, node_names, cluster_names = _dot(graph)
    try:
        try:
            process = _run(source, CAREFUL)
        except subprocess.TimeoutExpired:
            process = _run(source, TIMEOUT, *HURRY)
    except FileNotFoundError as error:
        raise LayoutError("Graphviz is missing; install the package graphviz") from error
    except subprocess.TimeoutExpired as error:
        raise LayoutError(f"Graphviz made no picture within {CAREFUL + TIMEOUT:g} s") from error
    if process.returncode or not process.stdout:
        raise LayoutError(f"Graphviz failed: {process.stderr.strip()[:300]}")
    return _read(json.loads(process.stdout), graph, node_names, cluster_names)


def _run(source: str, timeout: float, *options: str) -> "subprocess.CompletedProcess[str]":
    command = ["dot", *options, "-Tjson0", "-y"]
    return subprocess.run(command, input=source, capture_output=True, timeout=timeout, text=True, check=False)


def _dot(graph: DrawnGraph) -> Tuple[str, Dict[str, int], Dict[str, int]]:
    nodes = {node.id: number for number, node in enumerate(graph.nodes)}
    clusters = {cluster.id: number for number, cluster in enumerate(graph.clusters)}
    inside: Dict[str, List[str]] = {}
    for node in graph.nodes:
        inside.setdefault(node.cluster if node.cluster in clusters else "", []).append(_node(node, nodes))
    below: Dict[str, List[str]] = {}
    for cluster in graph.clusters:
        below.setdefault(cluster.parent if cluster.parent in clusters else "", []).append(cluster.id)
    lines = [
        "digraph {",
        f"graph [compound=true, rankdir={graph.direction}, nodesep=0.28, ranksep=0.42, pad=0.05]",
        'node [shape=box, fixedsize=true, label=""]',
        "edge [arrowsize=0.6]",
        *inside.get("", []),
    ]

    def open_cluster(identity: str) -> None:
        text = graph.clusters[clusters[identity]].text
        width = (len(text[:LONGEST_LABEL]) * LARGE + 24) / _POINTS
        lines.append(
            f'subgraph cluster_{clusters[identity]} {{ margin=14; labeljust=l; label=" "; '
            f"fontsize=13; lwidth={width:.2f};"
        )
        lines.extend(inside.get(identity, []))
        for child in below.get(identity, []):
            open_cluster(child)
        lines.append("}")

    for identity in below.get("", []):
        open_cluster(identity)
    for number, edge in enumerate(graph.edges):
        if edge.tail not in nodes or edge.head not in nodes:
            continue
        fields = [f"id=e{number}"]
        if edge.head_cluster in clusters:
            fields.append(f"lhead=cluster_{clusters[edge.head_cluster]}")
        if edge.text:
            width = len(edge.text[:LONGEST_LABEL]) * SMALL + 8
            # A table without text: room for what the page writes there.
            table = f'<table border="0" fixedsize="true" width="{width:.0f}" height="16">'
            fields.append(f"label=<{table}<tr><td></td></tr></table>>")
        lines.append(f"n{nodes[edge.tail]} -> n{nodes[edge.head]} [{', '.join(fields)}]")
    lines.append("}")
    return "\n".join(lines), nodes, clusters


def _node(node: Any, numbers: Dict[str, int]) -> str:
    width = max(52.0, len(node.text[:LONGEST_LABEL]) * (LARGE if node.kind != "outcome" else SMALL))
    width += _PADDING[node.kind]
    return f"n{numbers[node.id]} [width={width / _POINTS:.3f}, height={_HEIGHT[node.kind] / _POINTS:.3f}]"


def _read(
    answer: Dict[str, Any], graph: DrawnGraph, nodes: Dict[str, int], clusters: Dict[str, int]
) -> Dict[str, Any]:
    # With -y the origin is at the top left, as on a page.
    x0, y0, x1, y1 = _numbers(answer["bb"])
    left, top = min(x0, x1), min(y0, y1)
    names = {f"n{number}": graph.nodes[number] for number in nodes.values()}
    frames = {f"cluster_{number}": graph.clusters[number] for number in clusters.values()}
    picture: Dict[str, Any] = {
        "width": round(abs(x1 - x0), 1),
        "height": round(abs(y1 - y0), 1),
        "nodes": [],
        "clusters": [],
        "edges": [],
    }
    for item in answer.get("objects", []):
        node, cluster = names.get(item.get("name")), frames.get(item.get("name"))
        if node is not None and "pos" in item:
            x, y = _numbers(item["pos"])[:2]
            box = (x - left, y - top, *(float(item[side]) * _POINTS for side in ("width", "height")))
            shown = {"id": node.id, "text": node.text, "kind": node.kind, "in": node.cluster, **_box(*box)}
            picture["nodes"].append(shown)
        elif cluster is not None and "bb" in item:
            a, b, c, d = _numbers(item["bb"])
            box = (min(a, c) - left, min(b, d) - top, abs(c - a), abs(d - b))
            shown = {"id": cluster.id, "text": cluster.text, "in": cluster.parent, **_box(*box)}
            picture["clusters"].append(shown)
    for item in answer.get("edges", []):
        number = _edge_number(item.get("id"))
        if number is None or "pos" not in item:
            continue
        edge = graph.edges[number]
        shown = {"from": edge.tail, "to": edge.head, "text": edge.text, **_curve(item["pos"], left, top)}
        if "lp" in item:
            x, y = _numbers(item["lp"])[:2]
            shown["label"] = [round(x - left, 1), round(y - top, 1)]
        picture["edges"].append(shown)
    return picture


def _box(x: float, y: float, width: float, height: float) -> Dict[str, float]:
    return {name: round(value, 1) for name, value in zip("xywh", (x, y, width, height))}


def _curve(text: str, left: float, top: float) -> Dict[str, Any]:
    tip: Optional[List[float]] = None
    points: List[List[float]] = []
    for part in text.split():
        if part.startswith(("e,", "s,")):
            x, y = _numbers(part[2:])
            tip = [round(x - left, 1), round(y - top, 1)] if part[0] == "e" else tip
        else:
            x, y = _numbers(part)
            points.append([round(x - left, 1), round(y - top, 1)])
    return {"points": points, "tip": tip or points[-1]}


def _edge_number(text: Any) -> Optional[int]:
    return int(text[1:]) if isinstance(text, str) and text[1:].isdigit() else None


def _numbers(text: str) -> List[float]:
    return [float(part) for part in text.split(",")]


class LayoutThread:
    """Lays out the newest graph of every name, one after the other.

    :param done: called in this thread with the name and the picture, or the reason why there is no picture.
    """

    def __init__(self, done: Done) -> None:
        self._done = done
        self._waiting: Dict[str, Callable[[], Optional[DrawnGraph]]] = {}
        self._last: Dict[str, Tuple[DrawnGraph, Optional[Dict[str, Any]], str]] = {}
        self._queue: Optional[CallQueue] = None

    def start(self) -> None:
        """Begins to work."""
        self._queue = CallQueue("layout")
        self._queue.put(self.draw_waiting)

    def stop(self) -> None:
        """Ends; a picture under way is not waited for."""
        self._queue = None
        self._waiting.clear()

    def ask(self, name: str, graph: Callable[[], Optional[DrawnGraph]]) -> None:
        """Wants a picture; the graph is made when its turn comes, so the last one asked for is drawn."""
        self._waiting[name] = graph
        if self._queue is not None:
            self._queue.put(self.draw_waiting)

    def draw_waiting(self) -> None:
        """Lays out what waits, in the thread of the caller; instead of `start`."""
        for name in list(self._waiting):
            make = self._waiting.pop(name, None)
            if make is not None:
                self._lay_out(name, make)

    def _lay_out(self, name: str, make: Callable[[], Optional[DrawnGraph]]) -> None:
        try:
            picture, reason = self._draw(name, make)
        except Exception as error:  # one strange machine does not end all pictures
            picture, reason = None, failure_text(error)
        self._done(name, picture, reason)

    def _draw(
        self, name: str, make: Callable[[], Optional[DrawnGraph]]
    ) -> Tuple[Optional[Dict[str, Any]], str]:
        graph = make()
        if graph is None or not graph.nodes:
            self._last.pop(name, None)
            return None, ""
        known = self._last.get(name)
        if known is not None and known[0] == graph:
            return known[1], known[2]
        picture: Optional[Dict[str, Any]] = None
        reason = ""
        try:
            picture = layout(graph)
        except LayoutError as error:
            reason = str(error)
        self._last[name] = graph, picture, reason
        return picture, reason
