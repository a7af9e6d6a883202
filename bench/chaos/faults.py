# SPDX-License-Identifier: Apache-2.0
"""The faults that a campaign can do."""

from dataclasses import dataclass
from typing import Dict, FrozenSet, List, Optional, Tuple

#: When one of these nodes is lost, a drive has lost an owner, or the server that carries it out.
CHAIN: FrozenSet[str] = frozenset(
    {
        "client",
        "merlin_executor",
        "planning_system",
        "merlin_bridges",
        "merlin_fsm_host",
        "navigation",
        "merlin_guard",
        "master",
    }
)
#: Every node of the robot; the simulator is its world and its body, and is left alone.
NODES: Tuple[str, ...] = (
    "merlin_executor",
    "planning_system",
    "merlin_bridges",
    "merlin_fsm_host",
    "navigation",
    "soundplay_node",
    "listen",
    "merlin_guard",
    "merlin_explain",
)
MASTER = "master"
CLIENT = "client"
GUARD = "merlin_guard"
#: The action of the Executor.
EXECUTE = "merlin/execute"

SIGNAL = "signal"
LINK = "link"
CLOCK_BACK = "clock_back"
SECOND_CLOCK = "second_clock"
DISK_FULL = "disk_full"
SECOND_NODE = "second_node"
START = "start"
NONE = "none"
FORGED_PAUSE = "forged_pause"
CANCEL_AHEAD = "cancel_ahead"
PLAIN_GOAL = "plain_goal"
HALF_OPEN = "half_open"
SOCKETS = "sockets"
DESCRIPTORS = "descriptors"
THREADS = "threads"
WALL_CLOCK = "wall_clock"
AGAIN = "again"
PAGE_STOP = "page_stop"

#: Systems that differ from the usual one; :func:`chaos.trials.variant_of` says how.
PLAIN_SERVER = "plain_server"
ROBOT_TIME = "robot_time"
SET_TIME = "set_time"
PLAIN_SET_TIME = "plain_set_time"
ONE_PAGE = "one_page"
TWO_ROBOTS = "two_robots"

#: The node that is killed while the sockets of another are taken: it has to reach that one again.
PEERS = {
    "merlin_executor": "planning_system",
    "planning_system": "merlin_executor",
    "merlin_bridges": "planning_system",
    "merlin_fsm_host": "merlin_bridges",
    "navigation": "merlin_fsm_host",
    "soundplay_node": "merlin_fsm_host",
    "listen": "merlin_fsm_host",
    "merlin_guard": "merlin_fsm_host",
    "merlin_explain": "planning_system",
}
#: Silent connections to each port of a node.
CONNECTIONS = 20
#: s for which a node has no free descriptor.
SHORTAGE = 2.0
#: How often a node is killed again and again, and s in which all of that happens.
KILLS, KILLING = 4, 16.0
#: s for which it is back each time: others have seen it, they plan again, or something runs again.
DELAYS = {"back": 0.5, "planning": 1.5, "running": 2.5}
#: s by which the clock on the wall is set back.
HALF_MINUTE, DAY = 30.0, 86400.0

#: s that a SIGSTOP lasts that is not forever.
HANG = 10.0
#: s that a link is cut.
CUTS = (1.0, 5.0, 30.0)


@dataclass(frozen=True)
class Fault:
    """Something that breaks.

    :param name: of the fault, for tables and ``--faults``.
    :param kind: one of the constants of this module.
    :param targets: the nodes it strikes; `master` and `client` are among them.
    :param signal: KILL, STOP or TERM.
    :param lasts: s after which it is over by itself; None: forever, or until respawned.
    :param loss: share of packets that a link loses; 1: it is cut.
    :param delay: s that a link adds to each packet, or for which a node is back before it is killed again.
    :param on: what a fault of this kind is done to: a node, an action or a topic; `targets` and `signal` are
        then what happens to others in the same moment. "all": every node.
    :param amount: how much of it: connections, kills, or s of a clock.
    :param system: the system that it needs; empty: the usual one.
    """

    name: str
    kind: str
    targets: Tuple[str, ...] = ()
    signal: str = ""
    lasts: Optional[float] = None
    loss: float = 0.0
    delay: float = 0.0
    on: str = ""
    amount: float = 0.0
    system: str = ""

    @property
    def hangs(self) -> bool:
        """Whether its targets are not dead, but do nothing."""
        return self.kind in (LINK, HALF_OPEN) or self.signal == "STOP"

    @property
    def takes_owner(self) -> bool:
        """Whether a drive must end: it loses its owner, its server or its sensors, or a client stops it.

        A second node of a name takes none of them.
        """
        struck = bool(self.signal) and bool(CHAIN & set(self.targets))
        return struck or self.kind in (HALF_OPEN, PAGE_STOP) or (self.kind == LINK and self.loss >= 1.0)

    @property
    def cancels_each(self) -> bool:
        """Whether it cancels each request sent before it: so actionlib reads a cancel with a stamp."""
        return self.kind == CANCEL_AHEAD and self.on == EXECUTE

    @property
    def takes_what_nodes_need(self) -> bool:
        """Whether it takes sockets, descriptors or threads: then every node is asked whether it answers."""
        return self.kind in (SOCKETS, DESCRIPTORS, THREADS)

    @property
    def touches_guard(self) -> bool:
        """Whether the guard may end or fall silent: only then another one has to stop the base."""
        return GUARD in self.targets or (self.on == GUARD and self.kind in (DESCRIPTORS, THREADS))


def signals() -> List[Fault]:
    """Every node, the master and the client, with every signal."""
    return [fault for target in (*NODES, MASTER, CLIENT) for fault in _signals_of((target,))]


def pairs() -> List[Fault]:
    """Two nodes at once: all pairs of the chain that carries a request."""
    chain = ("merlin_executor", "planning_system", "merlin_bridges", "merlin_fsm_host", "navigation")
    both = [(one, other) for i, one in enumerate(chain) for other in chain[i + 1 :]]
    return [fault for pair in both for fault in _signals_of(pair)]


def _signals_of(targets: Tuple[str, ...]) -> List[Fault]:
    name = "+".join(targets)
    return [
        Fault(f"{name}:kill", SIGNAL, targets, "KILL"),
        Fault(f"{name}:stop10", SIGNAL, targets, "STOP", HANG),
        Fault(f"{name}:stop", SIGNAL, targets, "STOP"),
        Fault(f"{name}:term", SIGNAL, targets, "TERM"),
    ]


def links() -> List[Fault]:
    """The link between the robot and the rest: cut, lossy, slow."""
    cuts = [Fault(f"link:cut{lasts:g}", LINK, lasts=lasts, loss=1.0) for lasts in CUTS]
    return [
        *cuts,
        Fault("link:cut", LINK, loss=1.0),
        Fault("link:lossy", LINK, lasts=20.0, loss=0.2),
        Fault("link:slow", LINK, lasts=20.0, delay=0.2),
    ]


def others() -> List[Fault]:
    """What is neither a signal nor a link."""
    return [
        Fault("clock:back", CLOCK_BACK),
        Fault("clock:second", SECOND_CLOCK),
        Fault("disk:full", DISK_FULL, lasts=10.0),
        Fault("second:merlin_executor", SECOND_NODE, ("merlin_executor",)),
        Fault("second:merlin_bridges", SECOND_NODE, ("merlin_bridges",)),
        Fault("start:shuffled", START),
    ]


def shortages() -> List[Fault]:
    """A node whose sockets, descriptors or threads are taken, and that has to live on or to be restarted."""
    silent = [
        Fault(f"sockets:{node}", SOCKETS, (PEERS[node],), "KILL", on=node, amount=CONNECTIONS)
        for node in NODES
    ]
    return [
        *silent,
        *(Fault(f"descriptors:{node}", DESCRIPTORS, lasts=SHORTAGE, on=node) for node in NODES),
        *(Fault(f"threads:{node}", THREADS, on=node) for node in NODES),
    ]


def clocks() -> List[Fault]:
    """The clock on the wall of all nodes, or of one, is set back; stamps that are a day ahead."""
    ahead = [
        Fault(f"ahead:{action.replace('merlin/', '')}", CANCEL_AHEAD, on=action, amount=DAY)
        for action in (EXECUTE, "move_base")
    ]
    steps = {"all30": ("all", HALF_MINUTE), "allday": ("all", DAY)}
    steps.update({node: (node, DAY) for node in ("merlin_executor", "merlin_fsm_host", "navigation")})
    walls = [
        Fault(f"wall:{name}", WALL_CLOCK, on=node, amount=step, system=SET_TIME)
        for name, (node, step) in steps.items()
    ]
    plain = [
        Fault(f"wall:plain{name}", WALL_CLOCK, on="all", amount=step, system=PLAIN_SET_TIME)
        for name, step in (("30", HALF_MINUTE), ("day", DAY))
    ]
    return [*ahead, *walls, *plain]


def foreign() -> List[Fault]:
    """What is not MERLIN's: a forged state of the simulator, plain actionlib, sensors that fall silent."""
    hung = (FORGED_PAUSE, ("navigation",), "STOP")
    servers = [
        Fault(each.name.replace("navigation", PLAIN_SERVER), *_processes(each), system=PLAIN_SERVER)
        for each in _signals_of(("navigation",))
    ]
    return [
        Fault("forged:pause", *hung),
        Fault("forged:pause_on_robot", *hung, system=ROBOT_TIME),
        Fault("forged:pause_plain_server", *hung, system=PLAIN_SERVER),
        Fault("plain:goal", PLAIN_GOAL, on="move_base"),
        *(Fault(f"half_open:{topic}", HALF_OPEN, lasts=HANG, on=topic) for topic in ("tf", "scan", "odom")),
        *servers,
    ]


def _processes(fault: Fault) -> Tuple[str, Tuple[str, ...], str, Optional[float]]:
    return fault.kind, fault.targets, fault.signal, fault.lasts


def again() -> List[Fault]:
    """A node that is killed as soon as it is back."""
    node = "planning_system"
    return [
        Fault(f"again:{node}_{name}", AGAIN, (node,), "KILL", KILLING, delay=delay, on=node, amount=KILLS)
        for name, delay in DELAYS.items()
    ]


def pages() -> List[Fault]:
    """An operator presses *Stop and hold*; of one robot, and of two."""
    return [
        Fault("page:stop", PAGE_STOP, system=ONE_PAGE),
        Fault("page:stop_two", PAGE_STOP, system=TWO_ROBOTS),
    ]


def all_faults() -> Dict[str, Fault]:
    """Every fault by name."""
    kinds = (signals, pairs, links, others, shortages, clocks, foreign, again, pages)
    return {fault.name: fault for kind in kinds for fault in kind()}
