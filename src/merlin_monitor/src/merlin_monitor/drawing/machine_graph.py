# SPDX-License-Identifier: Apache-2.0
"""What is drawn of state machines and plans, as graphs without geometry."""

from collections import Counter
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

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
