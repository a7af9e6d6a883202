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
)
MASTER = "master"
CLIENT = "client"
GUARD = "merlin_guard"

SIGNAL = "signal"
LINK = "link"
CLOCK_BACK = "clock_back"
SECOND_CLOCK = "second_clock"
DISK_FULL = "disk_full"
SECOND_NODE = "second_node"
START = "start"
NONE = "none"

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
    :param delay: s that a link adds to each packet.
    """

    name: str
    kind: str
    targets: Tuple[str, ...] = ()
    signal: str = ""
    lasts: Optional[float] = None
    loss: float = 0.0
    delay: float = 0.0

    @property
    def hangs(self) -> bool:
        """Whether its targets are not dead, but do nothing."""
        return self.kind == LINK or self.signal == "STOP"

    @property
    def takes_owner(self) -> bool:
        """Whether a drive loses its owner or its server; a second node of a name takes neither."""
        struck = self.kind == SIGNAL and bool(CHAIN & set(self.targets))
        return struck or (self.kind == LINK and self.loss >= 1.0)


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


def all_faults() -> Dict[str, Fault]:
    """Every fault by name."""
    return {fault.name: fault for fault in (*signals(), *pairs(), *links(), *others())}
