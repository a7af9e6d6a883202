# SPDX-License-Identifier: Apache-2.0
"""What the doctor finds in what was gathered. Without ROS, network or files."""

from typing import Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

GUARD_TYPE = "merlin_msgs/GuardStatus"
STATUS_TYPE = "actionlib_msgs/GoalStatusArray"
VELOCITY_TYPE = "geometry_msgs/Twist"
CLOCK = "/clock"

OLDEST_PYTHON = (3, 8)
LEAST_FREE = 500  # MB on a disk that logs and knowledge are written to
MOST_APART = 0.5  # s between two clocks; a transform that is older is of no use to navigation


class Finding(NamedTuple):
    """What is wrong and what to do; or, where nothing is wrong, what should be known."""

    text: str
    wrong: bool = True


class Machine(NamedTuple):
    """What this computer has."""

    python: Tuple[int, int] = OLDEST_PYTHON
    missing: Sequence[str] = ()
    """Python modules that cannot be imported."""
    packages: str = ""
    """Why ROS does not find the package merlin, with what to do; empty: it does."""
    planner: bool = True
    free: Dict[str, int] = {}
    """MB by folder; a negative number: it cannot be written."""
    host: str = "localhost"
    host_resolves: bool = True
    address: str = ""
    """What the user gives as its address, NAME=value; empty: nothing."""
    address_is_own: bool = True
    master: str = "localhost"
    """Where ROS_MASTER_URI leads; empty: it is not http://host:port."""
    master_is_elsewhere: bool = False
    sound: str = ""
    """Why nothing can be heard, with what to do; empty: nothing is known against it."""
    patient_tcp: bool = True
    """Whether the kernel lets the wait between two tries of TCP be bounded."""


class Graph(NamedTuple):
    """What the master knows."""

    publishers: Dict[str, List[str]] = {}
    """Nodes by topic."""
    subscribers: Dict[str, List[str]] = {}
    types: Dict[str, str] = {}
    silent: Dict[str, str] = {}
    """Nodes that do not answer, and why."""
    misnamed: Dict[str, str] = {}
    """Which of them gave a host that has no address here, or this one although they are elsewhere."""
    simulated_time: bool = False
    planner_command: bool = False
    """Whether a planning system has a planner of its own."""

    def of_type(self, kind: str) -> List[str]:
        """Topics of a type that a living node publishes."""
        return sorted(topic for topic in self.publishers if self.types.get(topic) == kind and self.who(topic))

    def who(self, topic: str) -> List[str]:
        """Living nodes that publish a topic."""
        return sorted(set(self.publishers.get(topic, ())) - set(self.silent))

    def receivers(self, topic: str) -> List[str]:
        """Living nodes that subscribe to a topic."""
        return sorted(set(self.subscribers.get(topic, ())) - set(self.silent))


class Heard(NamedTuple):
    """What was published while the doctor listened."""

    seconds: float = 3.5
    ahead: Dict[str, Optional[float]] = {}
    """By topic, how far its newest stamp was ahead of ROS time here, s; None: it has no stamp."""
    parents: Dict[str, List[str]] = {}
    """Of each frame of tf."""
    health: Dict[str, Tuple[int, str]] = {}
    """By part, the level of diagnostic_msgs and the message."""
    guards: Dict[str, str] = {}
    """By topic, the warning of a guard."""


def judge_machine(machine: Machine, planner_command: bool = False) -> Iterator[Finding]:
    """What is wrong with a computer.

    :param planner_command: whether a planning system that runs has a planner of its own.
    """
    python = ".".join(map(str, machine.python))
    if machine.python < OLDEST_PYTHON:
        yield Finding(f"Python {python} is too old; MERLIN needs 3.8 or newer")
    if machine.missing:
        names = ", ".join(machine.missing)
        yield Finding(
            f"Python cannot import {names}; run 'make build PROFILE=robot', source devel/setup.bash"
        )
    if machine.packages:
        yield Finding(machine.packages)
    if not machine.planner and not planner_command:
        what = f"kairos, which needs Python 3.10, is not installed for this {python}"
        yield Finding(f"there is no planner: {what}; install it, popf or lpg, or set planner_command:=")
    for folder, free in sorted(machine.free.items()):
        if free < 0:
            yield Finding(f"{folder} cannot be written; give it to this user, or set ROS_HOME")
        elif free < LEAST_FREE:
            yield Finding(f"only {free} MB are free for {folder}; remove old logs: rosclean purge")
    name = machine.host
    if not machine.host_resolves and not machine.address and not machine.master_is_elsewhere:
        yield Finding(f"the name '{name}' has no address; write '127.0.1.1 {name}' into /etc/hosts")
    if not machine.address_is_own:
        yield Finding(
            f"{machine.address} is not an address of this computer, so no node here is reached; correct it"
        )
    if not machine.master:
        yield Finding("ROS_MASTER_URI is not http://host:port; correct it")
    if machine.master_is_elsewhere and not machine.address:
        yield Finding(
            "the master is on another computer; set ROS_IP to the address at which it reaches this one"
        )
    if machine.sound:
        yield Finding(machine.sound, wrong=False)
    if machine.master_is_elsewhere and not machine.patient_tcp:
        what = "before Linux 6.15 there is no tcp_rto_max_ms"
        yield Finding(
            f"{what}: after a cut of the link, topics come back as late as it was long", wrong=False
        )


def judge_graph(graph: Graph) -> Iterator[Finding]:
    """What is wrong with the nodes of a system and how they are connected."""
    for node, why in sorted(graph.silent.items()):
        if node not in graph.misnamed:
            yield Finding(f"{node} does not answer ({why}); end its process, or remove it: rosnode cleanup")
    for host in sorted(set(graph.misnamed.values())):
        names = ", ".join(sorted(node for node, its in graph.misnamed.items() if its == host))
        what = f"{names} cannot be reached from here at '{host}', so nothing of it arrives"
        yield Finding(f"{what}; set ROS_IP on its computer, start it anew; of dead ones: rosnode cleanup")
    clocks = graph.who(CLOCK)
    if graph.simulated_time and not clocks:
        yield Finding(
            "/use_sim_time is true and nothing publishes /clock; set it to false before nodes start"
        )
    if clocks and not graph.simulated_time:
        yield Finding(f"{clocks[0]} publishes /clock, /use_sim_time is false; set it before nodes start")
    if len(clocks) > 1:
        yield Finding(f"{', '.join(clocks)} all publish /clock; leave one")
    yield from _judge_velocities(graph)
    for topic in graph.of_type(STATUS_TYPE):
        servers = graph.who(topic)
        if len(servers) > 1:
            yield Finding(f"{', '.join(servers)} all serve the action {topic.rpartition('/')[0]}; leave one")
    for topic in sorted(graph.publishers):
        action, _, last = topic.rpartition("/")
        clients = graph.who(topic)
        is_goal = last == "goal" and graph.types.get(topic, "").endswith("ActionGoal")
        if is_goal and clients and not graph.receivers(topic):
            yield Finding(
                f"{', '.join(clients)} uses the action {action}, which nothing serves; start or remap it"
            )


def _judge_velocities(graph: Graph) -> Iterator[Finding]:
    """The guard is the only way to a base, next to it, and navigation sends through it."""
    guards = {node for topic in graph.of_type(GUARD_TYPE) for node in graph.who(topic)}
    for topic in sorted(topic for topic, kind in graph.types.items() if kind == VELOCITY_TYPE):
        senders, receivers = graph.who(topic), graph.receivers(topic)
        behind = sorted(guards.intersection(senders))
        others = ", ".join(sorted(set(senders) - guards))
        if len(behind) > 1:
            yield Finding(f"{', '.join(behind)} all guard {topic}; a base has one guard: end the others")
        if behind and others:
            what = f"{others} publishes on {topic}, past the guard, which cannot stop it"
            yield Finding(f"{what}; remap its cmd_vel to cmd_vel_in of the guard")
        if behind and not receivers:
            yield Finding(f"no base listens to {topic} of {behind[0]}; start its driver, or set cmd_vel:=")
        if guards.intersection(receivers) and not senders:
            yield Finding(
                f"nothing sends on {topic}, which the guard reads; remap cmd_vel of navigation to it"
            )
        if not guards and receivers and others:
            yield Finding(f"no guard is between {others} and {topic}; start robot.launch with guard:=true")


def judge_heard(heard: Heard, statuses: Sequence[str]) -> Iterator[Finding]:
    """What is wrong with what is published.

    :param statuses: the status topics of the actions that are served.
    """
    for topic in sorted(set(statuses) - set(heard.ahead)):
        what = f"{topic} was silent for {heard.seconds:g} s, and is due once per second"
        yield Finding(f"{what}; its server hangs, or cannot reach this computer")
    for topic, ahead in sorted(heard.ahead.items()):
        if ahead is not None and abs(ahead) > MOST_APART:
            what = f"{topic} is {abs(ahead):.1f} s {'ahead of' if ahead > 0 else 'behind'} the clock here"
            yield Finding(f"{what}; set the clocks of all computers by one source (chrony)")
    for frame, parents in sorted(heard.parents.items()):
        if len(parents) > 1:
            yield Finding(
                f"tf: {frame} has the parents {', '.join(sorted(parents))}; end one publisher of it"
            )
    named = {parent for parents in heard.parents.values() for parent in parents}
    roots = sorted(named - set(heard.parents))
    if len(roots) > 1:
        yield Finding(
            f"tf: nothing connects {', '.join(roots)}; start what publishes a transform between them"
        )
    for part, (level, message) in sorted(heard.health.items()):
        if level:
            yield Finding(f"{part}: {message}", wrong=level > 1)
    for topic, warning in sorted(heard.guards.items()):
        if warning:
            yield Finding(f"{topic}: {warning}", wrong=False)
