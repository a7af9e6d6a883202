# SPDX-License-Identifier: Apache-2.0
"""Sets the breakpoints of Executor, dispatcher and machines, and continues what they hold."""

from typing import Any, Dict, List, Mapping, NamedTuple, Sequence, Tuple

import rospy
from merlin_msgs.srv import Breakpoints, BreakpointsRequest, BreakpointsResponse, LeaveState, SetAutonomy

from merlin_pddl.breakpoints import ANY, BreakpointError, read_pattern
from merlin_pddl.text_reader import suggestion
from merlin_planning.knowledge_client import KnowledgeClient
from merlin_ros.master.master_link import ERRORS, bounded_master
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_sm.holding.node_holds import AUTONOMY_SERVICE, LEAVE_SERVICE, SERVICE
from merlin_sm.holding.state_holds import names_state, read_state_pattern

LIMIT = 3.0  # s of wall time for an answer


class Stepped(NamedTuple):
    """What a step did."""

    said: str
    state: str
    """The state that a machine entered; empty: it was a step of the plan."""


class MachineNodes:
    """All nodes of one robot that run state machines: their breakpoints, outcomes and autonomy levels.

    All methods raise :class:`BreakpointError` when something is not done; the text says what.

    :param namespace: of the robot, empty or with a slash at its end.
    """

    def __init__(self, namespace: str = "") -> None:
        self._namespace = namespace
        self._proxies: Dict[str, ServiceProxy] = {}

    def set(self, texts: Sequence[str]) -> None:
        """Replaces all breakpoints on states; where no machine has one of the states, all others are set."""
        for text in texts:
            read_state_pattern(text)
        done = {text for answer in self._ask(BreakpointsRequest.SET, texts) for text in answer.breakpoints}
        missing = [text for text in texts if text.strip() not in done]
        if missing:
            raise BreakpointError(f"no machine has a state {', '.join(missing)}")

    def look(self) -> Tuple[List[str], List[str]]:
        """The breakpoints, and the states before which machines are held, as :meth:`leave` takes them."""
        answers = self._ask(BreakpointsRequest.LOOK)
        texts = dict.fromkeys(text for answer in answers for text in answer.breakpoints)
        return list(texts), [answer.held for answer in answers if answer.held]

    def release(self, what: int) -> str:
        """Continues machines that are held before a state.

        :param what: of a request: STEP, CONTINUE or CLEAR.
        :return: what was held; empty: nothing.
        """
        return ", ".join(answer.held for answer in self._ask(what) if answer.held)

    def leave(self, state: str, outcome: str, by: str, within: str = "") -> str:
        """Makes a state that runs, is held or waits end with an outcome.

        :param state: ``NAVIGATE/DRIVE``; of one of several robots in one plan ``ann/NAVIGATE/DRIVE``.
        :param outcome: one of the state; empty: the one with which it waits is confirmed.
        :param by: the operator.
        :param within: namespace of the node, with a slash at its end; empty: that of the robot.
        :return: what happens now.
        """
        read_state_pattern(state)
        missed: List[str] = []
        nodes, inside = self._nodes(), self._inside()
        robots = {robot for robot in map(self._robot, nodes) if robot}
        robot, _, of_robot = state.partition("/")
        if not within and robot in robots and of_robot:
            within, state = f"{inside}{robot}/", of_robot
        # Robots in further namespaces may have states of the same names.
        for node in nodes:
            if f"{node.rpartition('/')[0]}/" != (within or inside):
                continue
            answer = self._call(f"{node}/{LEAVE_SERVICE}", LeaveState, state, outcome, by)
            if answer is not None and answer.success:
                return str(answer.message)
            if answer is not None and answer.here:
                missed.append(answer.message)
        which = f"; begin with the robot: {', '.join(sorted(robots))}" if robots and not within else ""
        raise BreakpointError("; ".join(missed) or f"no machine has a state {state}{which}")

    def set_autonomy(self, level: str) -> None:
        """Sets the autonomy level of all nodes."""
        answers = [self._call(f"{node}/{AUTONOMY_SERVICE}", SetAutonomy, level) for node in self._nodes()]
        missed = dict.fromkeys(answer.message for answer in answers if answer and not answer.success)
        if missed or not any(answers):
            raise BreakpointError("; ".join(missed) or "no node runs state machines")

    def _ask(self, what: int, texts: Sequence[str] = ()) -> List[BreakpointsResponse]:
        """Asks every node; one that is gone has no breakpoints."""
        answers, missed = [], []
        for node in self._nodes():
            proxy = self._proxy(f"{node}/{SERVICE}", Breakpoints)
            if proxy.available():
                try:
                    answer = _call(proxy, what, texts)
                    if answer.held and self._robot(node):
                        answer.held = f"{self._robot(node)}/{answer.held}"
                    answers.append(answer)
                except BreakpointError as error:
                    missed.append(str(error))
        if missed:
            raise BreakpointError("; ".join(missed))
        return answers

    def _nodes(self) -> List[str]:
        try:
            services = bounded_master().getSystemState()[2]
        except ERRORS as error:
            raise BreakpointError(f"the ROS master does not answer: {error}") from error
        inside, end = self._inside(), f"/{SERVICE}"
        return [name[: -len(end)] for name, _ in services if name.startswith(inside) and name.endswith(end)]

    def _robot(self, node: str) -> str:
        """The robot in whose namespace a node is; empty: in that of all."""
        return node[len(self._inside()) :].rpartition("/")[0].partition("/")[0]

    def _inside(self) -> str:
        return str(rospy.resolve_name(f"{self._namespace}{SERVICE}"))[: -len(SERVICE)]

    def _proxy(self, name: str, service_class: type) -> ServiceProxy:
        return self._proxies.setdefault(name, ServiceProxy(name, service_class, timeout=LIMIT))

    def _call(self, name: str, service_class: type, *request: str) -> Any:
        """The answer; None: nothing offers the service any more."""
        proxy = self._proxy(name, service_class)
        try:
            return proxy(*request) if proxy.available() else None
        except ServiceError as error:
            raise BreakpointError(str(error)) from error


class BreakpointClient:
    """The breakpoints of one robot: on goals (Executor), actions (dispatcher) and states (machines).

    All methods raise :class:`BreakpointError` when something is not done; the text says what.

    :param knowledge: knows what is an action and what a goal.
    :param namespace: of the robot, empty or with a slash at its end.
    :param dispatcher: name of its dispatcher.
    """

    def __init__(
        self, knowledge: KnowledgeClient, namespace: str = "", dispatcher: str = "rosplan_plan_dispatcher"
    ) -> None:
        self._knowledge = knowledge
        self._goals = ServiceProxy(f"{namespace}merlin/breakpoints", Breakpoints, timeout=LIMIT)
        self._actions = ServiceProxy(f"{namespace}{dispatcher}/breakpoints", Breakpoints, timeout=LIMIT)
        self.states = MachineNodes(namespace)

    def set(self, texts: Sequence[str]) -> None:
        """Replaces all breakpoints: actions and facts of goals, with ``*`` for any argument; states."""
        states = [text for text in texts if names_state(text)]
        texts = [text for text in texts if text not in states]
        of_actions, of_goals = self._sorted(texts) if texts else ([], [])
        self._ask(BreakpointsRequest.SET, of_actions, of_goals)
        self.states.set(states)

    def _sorted(self, texts: Sequence[str]) -> Tuple[List[str], List[str]]:
        """Those on actions, and those on goals."""
        try:
            actions = _counts(self._knowledge.operators())
            facts = _counts({**self._knowledge.predicates(), **self._knowledge.function_signatures()})
            objects = {name.lower() for name in self._knowledge.instances()}
        except ServiceError as error:
            raise BreakpointError(f"the domain cannot be read: {error}") from error
        heads: Dict[str, str] = {}
        for text in texts:
            head, *arguments = read_pattern(text)
            heads[text] = head
            counts = [known[head] for known in (actions, facts) if head in known]
            if not counts:
                also = suggestion(head, [*actions, *facts])
                raise BreakpointError(f"the domain has neither an action nor a predicate '{head}'{also}")
            if arguments and len(arguments) not in counts:  # a name alone is for any
                raise BreakpointError(f"{text}: {head} takes {counts[0]} arguments; write * for any")
            for name in arguments:
                if name != ANY and name not in objects:
                    raise BreakpointError(f"{text}: there is no object '{name}'{suggestion(name, objects)}")
        of_actions = [text for text in texts if heads[text] in actions]
        return of_actions, [text for text in texts if heads[text] in facts]

    def step(self) -> Stepped:
        """Steps: the held state or action begins, and the next one is held."""
        state = self.states.release(BreakpointsRequest.STEP)
        if state:
            return Stepped(f"{state} begins, and the next state is held.", state)
        said = _call(self._actions, BreakpointsRequest.STEP, ()).message
        return Stepped(f"{said} {_call(self._goals, BreakpointsRequest.CONTINUE, ()).message}", "")

    def go_on(self) -> str:
        """What is held begins, and what follows up to the next breakpoint."""
        return self._ask(BreakpointsRequest.CONTINUE)

    def clear(self) -> str:
        """Removes all breakpoints, and continues."""
        return self._ask(BreakpointsRequest.CLEAR)

    def _ask(self, what: int, actions: Sequence[str] = (), goals: Sequence[str] = ()) -> str:
        """Asks all, the further ones also when the first is not there."""
        said: List[str] = []
        missed: List[str] = []
        for proxy, before in ((self._actions, actions), (self._goals, goals)):
            try:
                said.append(_call(proxy, what, before).message)
            except BreakpointError as error:
                missed.append(str(error))
        if what != BreakpointsRequest.SET:
            try:
                state = self.states.release(what)
                said += [f"{state} begins."] if state else []
            except BreakpointError as error:
                missed.append(str(error))
        if missed:
            raise BreakpointError("; ".join([*said, *missed]))
        return " ".join(said)


def _counts(signatures: Mapping[str, Any]) -> Dict[str, int]:
    """How many arguments each takes."""
    return {name.lower(): len(signature.typed_parameters) for name, signature in signatures.items()}


def _call(proxy: ServiceProxy, what: int, before: Sequence[str]) -> BreakpointsResponse:
    if not proxy.available():
        raise BreakpointError(f"nothing offers {proxy.name}")
    try:
        answer = proxy(what, list(before))
    except ServiceError as error:
        raise BreakpointError(str(error)) from error
    if not answer.success:
        raise BreakpointError(answer.message)
    return answer
