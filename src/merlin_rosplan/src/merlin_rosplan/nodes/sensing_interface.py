# SPDX-License-Identifier: Apache-2.0
"""ROSPlan's sensing interface: updates facts and function values from topics and services."""

import importlib.util
import inspect
import math
import re
from types import ModuleType
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence

import roslib.message
import rospkg
import rospy
from merlin_msgs.msg import KnowledgeChanges
from rosplan_knowledge_msgs.msg import KnowledgeItem, StatusUpdate
from rosplan_knowledge_msgs.srv import SetNamedBool

from merlin_planning.foreign_changes import ForeignChanges
from merlin_planning.knowledge_client import knowledge_client
from merlin_ros.parameters import is_name
from merlin_ros.ros_alarm import RosAlarm
from merlin_ros.service_proxy import ServiceError, ServiceProxy
from merlin_ros.work.threads import CallQueue, failure_text
from merlin_rosplan.knowledge.sensed_facts import facts_of, parameter_choices
from merlin_rosplan.transport.component import Component, ComponentError
from merlin_rosplan.transport.sensed_updater import LOG_PERIOD, SensedUpdater

KNOWLEDGE_BASE_WAIT = 30.0  # s of wall time


class Sensor(NamedTuple):
    """One way to sense one predicate or function.

    :param predicate: name in the domain.
    :param given: its ``params``.
    :param evaluate: (message or response, choices, topic) → result.
    :param types: of the predicate's parameters.
    """

    predicate: str
    given: Sequence[Any]
    evaluate: Callable[[Any, List[List[str]], str], Any]
    types: Sequence[str]


class SensingInterface(Component):
    """Sensors as ``~topics`` and ``~services`` configure them, with functions of the script ``~functions``.

    News is sent at once, in batches of at most ``~main_rate`` per second.
    """

    def __init__(self, scope: str) -> None:
        super().__init__(scope)
        period = 1.0 / self.number("main_rate", 10.0, 0.001)
        self._knowledge = knowledge_client(self.knowledge_base)
        if not self._knowledge.wait(KNOWLEDGE_BASE_WAIT):
            raise ComponentError(f"no knowledge base {self.knowledge_base} after {KNOWLEDGE_BASE_WAIT:g} s")
        try:
            self._signatures = {**self._knowledge.predicates(), **self._knowledge.function_signatures()}
        except ServiceError as error:
            raise ComponentError(str(error)) from error
        self._script = self._load_script()
        self._mark_sensed()
        self._updater = SensedUpdater(self._knowledge, period, self.scope)
        self._marks = CallQueue(f"marks of {self.scope}")
        self._changes = self.own(ForeignChanges(self.knowledge_base, self._others_changed))
        self.subscriber(f"{self.knowledge_base}/status/update", StatusUpdate, self._receive_update)
        for key, add in (("topics", self._add_topic), ("services", self._add_service)):
            for predicate, entries in self._config(key).items():
                for entry in entries:
                    try:
                        add(predicate, entry)
                    except ValueError as error:  # of ROS, for a type without its package
                        raise ComponentError(f"the sensor of '{predicate}': {error}") from error

    def on_shutdown(self) -> None:
        """Ends the thread that updates the knowledge base."""
        self._updater.close()

    # --- configuration ------------------------------------------------------------------------------

    def _config(self, key: str) -> Dict[str, List[Dict[str, Any]]]:
        config = self.param(key, {})
        if not isinstance(config, dict):
            raise ComponentError(f"{self.resolve(key)} must map predicates to their sensors")
        result = {}
        for predicate, entries in config.items():
            entries = entries if isinstance(entries, list) else [entries]
            if not all(isinstance(entry, dict) for entry in entries):
                raise ComponentError(
                    f"{self.resolve(key)}/{predicate} must be a mapping or a list of mappings"
                )
            if str(predicate).lower() not in {name.lower() for name in self._signatures}:
                raise ComponentError(
                    f"{self.resolve(key)}: the domain has no predicate or function '{predicate}'"
                )
            result[str(predicate)] = entries
        return result

    def _load_script(self) -> Optional[ModuleType]:
        paths = self.param("functions", [])
        if not paths:
            return None
        path = str(paths[0] if isinstance(paths, list) else paths)
        try:
            packages = rospkg.RosPack()
            path = re.sub(r"\$\(find ([^)]+)\)", lambda found: packages.get_path(found.group(1)), path)
            spec = importlib.util.spec_from_file_location("sensing_functions", path)
            if spec is None or spec.loader is None:
                raise ComponentError(f"{self.resolve('functions')}: {path} is not a Python file")
            script = importlib.util.module_from_spec(spec)
            script.get_kb_attribute = self._knowledge.propositions  # type: ignore[attr-defined]
            spec.loader.exec_module(script)
            return script
        except ComponentError:
            raise
        except Exception as error:  # user code; whatever it raises, the node has to say which file it was
            raise ComponentError(f"{path} cannot be loaded: {failure_text(error)}") from error

    def _mark_sensed(self) -> None:
        name = f"{self.knowledge_base}/update_sensed_predicates"
        mark = ServiceProxy(name, SetNamedBool, timeout=5.0, patience=KNOWLEDGE_BASE_WAIT)
        for predicate in {**self._config("topics"), **self._config("services")}:
            try:
                mark(predicate, True)
            except ServiceError as error:
                rospy.logwarn("%s: '%s' is not marked as sensed: %s", self.scope, predicate, error)
        mark.close()

    def _required(self, predicate: str, entry: Dict[str, Any], key: str) -> Any:
        if key not in entry:
            raise ComponentError(f"the sensor of '{predicate}' lacks '{key}'")
        return entry[key]

    def _name(self, predicate: str, name: Any) -> str:
        if not is_name(name):
            raise ComponentError(f"the sensor of '{predicate}': {name!r} is not a name of ROS")
        return str(name)

    def _sensor(self, predicate: str, entry: Dict[str, Any], variable: str) -> Sensor:
        types = next(
            [parameter.value for parameter in formula.typed_parameters]
            for name, formula in self._signatures.items()
            if name.lower() == predicate.lower()
        )
        given = entry.get("params", [])
        if not isinstance(given, list) or len(given) not in (0, len(types)):
            raise ComponentError(
                f"the sensor of '{predicate}': params is {given!r}, expected a list of {len(types)}, "
                "one for each parameter, or none"
            )
        operation = entry.get("operation")
        if operation is not None:
            code = self._compile(predicate, str(operation))
            scope = dict(vars(self._script)) if self._script is not None else {}
            return Sensor(
                predicate,
                given,
                lambda message, choices, topic: eval(code, scope, {variable: message, "params": choices}),
                types,
            )
        function = getattr(self._script, predicate, None)
        if not callable(function):
            raise ComponentError(
                f"the sensor of '{predicate}' has no operation, and no function of that name is in the script"
            )
        if variable == "msg" and _takes_topic(function):
            return Sensor(predicate, given, function, types)
        return Sensor(predicate, given, lambda message, choices, topic: function(message, choices), types)

    def _compile(self, predicate: str, expression: str) -> Any:
        try:
            return compile(expression, f"<operation of {predicate}>", "eval")
        except SyntaxError as error:
            raise ComponentError(
                f"the operation of '{predicate}' is not a Python expression: {error}"
            ) from error

    def _add_topic(self, predicate: str, entry: Dict[str, Any]) -> None:
        sensor = self._sensor(predicate, entry, "msg")
        type_name = str(self._required(predicate, entry, "msg_type"))
        message_class = roslib.message.get_message_class(type_name)
        if message_class is None:
            raise ComponentError(f"the sensor of '{predicate}': there is no message type {type_name}")
        topics = self._required(predicate, entry, "topic")
        for topic in topics if isinstance(topics, list) else [topics]:
            self.own(
                rospy.Subscriber(
                    self._name(predicate, topic),
                    message_class,
                    lambda message, name=topic: self._sense(sensor, message, name),
                    tcp_nodelay=True,
                )
            )

    def _add_service(self, predicate: str, entry: Dict[str, Any]) -> None:
        sensor = self._sensor(predicate, entry, "res")
        type_name = str(self._required(predicate, entry, "srv_type"))
        service_class = roslib.message.get_service_class(type_name)
        if service_class is None:
            raise ComponentError(f"the sensor of '{predicate}': there is no service type {type_name}")
        request = self._request(predicate, entry, service_class)
        period = self._required(predicate, entry, "time_between_calls")
        if isinstance(period, bool) or not isinstance(period, (int, float)) or not math.isfinite(period):
            raise ComponentError(
                f"the sensor of '{predicate}': time_between_calls is not a number: {period!r}"
            )
        name = self._name(predicate, self._required(predicate, entry, "service"))
        proxy = ServiceProxy(name, service_class, timeout=10.0)

        def call() -> None:
            try:
                self._sense(sensor, proxy(request()), proxy.name)
            except Exception as error:  # the request is user code too; the service is asked again
                reason = str(error) if isinstance(error, ServiceError) else failure_text(error)
                rospy.logwarn_throttle(LOG_PERIOD, f"{self.scope}: '{predicate}': {reason}")
            if not self.closed:
                alarm.set_after(max(period, 0.001))

        alarm = self.own(RosAlarm(call, f"calls for {predicate}"))
        alarm.set_after(0.0)

    def _request(self, predicate: str, entry: Dict[str, Any], service_class: Any) -> Callable[[], Any]:
        text = entry.get("request")
        made = getattr(self._script, f"req_{predicate}", None)
        if text is None and callable(made):
            return made
        if text is None:
            return service_class._request_class
        code = self._compile(predicate, str(text))
        scope = dict(vars(self._script)) if self._script is not None else {}
        scope[service_class._request_class.__name__] = service_class._request_class
        return lambda: eval(code, scope)

    # --- sensing and sending --------------------------------------------------------------------------

    def _sense(self, sensor: Sensor, message: Any, source: str) -> None:
        def report(text: str) -> None:
            rospy.logerr_throttle_identical(LOG_PERIOD, f"{self.scope}: sensing '{sensor.predicate}': {text}")

        try:
            choices = parameter_choices(sensor.given, sensor.types, self._knowledge.instances)
            facts = facts_of(sensor.predicate, sensor.evaluate(message, choices, source), choices, report)
        except Exception as error:  # user code may raise anything; the other sensors continue
            report(failure_text(error))
            return
        self._updater.sense(facts)

    def _others_changed(self, message: Optional[KnowledgeChanges]) -> None:
        if message is None:
            self._marks.put(self._mark_sensed)  # without a state file it has no marks of its life before
            self._updater.send_again()
            self._updater.objects_appeared()
            return
        items = [*message.added, *message.removed, *message.changed]
        names = {item.attribute_name for item in items if item.attribute_name}
        if names:
            self._updater.send_again(sorted(names))
        if any(item.knowledge_type == KnowledgeItem.INSTANCE for item in message.added):
            self._updater.objects_appeared()

    def _receive_update(self, message: StatusUpdate) -> None:
        # A knowledge base that publishes the changes themselves says more there.
        if message.last_update_client != rospy.get_name() and not self._changes.connected:
            self._updater.send_again()


def _takes_topic(function: Callable[..., Any]) -> bool:
    try:
        return len(inspect.signature(function).parameters) > 2
    except (TypeError, ValueError):  # some builtins have no signature
        return False
