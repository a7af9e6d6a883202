"""All listeners of a node, connected with one model. The page's node and the terminal view both use them."""

import time
from typing import Dict

import rospy

from merlin_monitor.listeners.graph_watch import GraphWatch
from merlin_monitor.listeners.knowledge_listener import KnowledgeListener
from merlin_monitor.listeners.machine_listener import MachineListener
from merlin_monitor.listeners.map_listener import MapListener
from merlin_monitor.listeners.mission_listener import MissionListener
from merlin_monitor.listeners.planning_listener import PlanningListener
from merlin_monitor.listeners.pulse import Pulse
from merlin_monitor.state.freshness import Source
from merlin_monitor.state.monitor_model import MonitorModel


class RosListeners:
    """Reads the parameters that name what is followed, and follows it.

    :param state: the model.
    """

    def __init__(self, state: MonitorModel) -> None:
        namespace = rospy.get_namespace()
        robot = namespace.strip("/")
        prefix = f"{robot}/" if robot else ""
        name = rospy.get_param
        self.knowledge_base = str(name("~knowledge_base", "rosplan_knowledge_base"))
        self.executor = str(name("~executor", "merlin/execute"))
        self._knowledge = KnowledgeListener(state, self.knowledge_base)
        self._planning = PlanningListener(
            state,
            planner=str(name("~planner_interface", "rosplan_planner_interface")),
            parser=str(name("~parsing_interface", "rosplan_parsing_interface")),
            dispatcher=str(name("~plan_dispatcher", "rosplan_plan_dispatcher")),
        )
        self._mission = MissionListener(state, self.executor)
        self._machines = MachineListener(state, namespace)
        self._map = MapListener(
            state,
            map_topic=str(name("~map_topic", "/map")),
            global_frame=str(name("~global_frame", "map")),
            base_frame=str(name("~base_frame", f"{prefix}base_footprint")),
            people_topic=str(name("~people_topic", "people")),
        )
        self._pulse = Pulse(state, self._map.sample, self._sources)
        self._watch = GraphWatch(self._look)
        for field, value in (
            ("robot", robot),
            ("simulated", bool(name("/use_sim_time", False))),
            ("started", time.time()),
        ):
            state.tree.set("meta", field, value)

    def start(self) -> None:
        """Begins to follow."""
        self._knowledge.start()
        self._watch.start()
        self._pulse.start()

    def _sources(self) -> Dict[str, Source]:
        """Where the sections have their news from, and whether that is connected."""
        executor = self._source(self._mission.status)
        return {
            "now": executor,
            "queue": executor,
            "plan": self._source(self._planning.dispatched),
            "knowledge": self._source(*self._knowledge.subscribers),
            "map": Source(self._map.located, "the robot's position"),
        }

    def _source(self, *subscribers: rospy.Subscriber) -> Source:
        connected = [each for each in subscribers if each.get_num_connections()]
        return Source(bool(connected), self._watch.publisher_of((connected or subscribers)[0].resolved_name))

    def _look(self, topics: Dict[str, str]) -> None:
        self._machines.look(topics)
        self._planning.look(topics)
        self._knowledge.look(topics, self._watch)
        self._map.look(topics)
