"""Publishes the markers while rviz listens."""

import threading
from typing import Any, List, Optional

import rospy
from visualization_msgs.msg import Marker, MarkerArray

from merlin_monitor.rviz.markers import markers
from merlin_monitor.state.monitor_model import MonitorModel


class MarkerPublisher(rospy.SubscribeListener):
    """Publishes the markers whenever they change, while there is a subscriber.

    :param state: what is shown.
    :param frame: of the map.
    """

    def __init__(self, state: MonitorModel, frame: str) -> None:
        super().__init__()
        self._state = state
        self._frame = frame
        self._changed = threading.Condition()  # guards the fields below
        self._wake = self._newcomer = self._ended = False
        self._feed = state.tree.subscribe(self._woken)
        self._topic = rospy.Publisher("merlin/markers", MarkerArray, self, queue_size=2)
        self._thread = threading.Thread(target=self._work, name="markers", daemon=True)

    def start(self) -> None:
        """Begins to publish."""
        self._thread.start()

    def stop(self) -> None:
        """Ends the thread that publishes."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def peer_subscribe(self, *_: Any) -> None:
        """A new subscriber gets what is shown now."""
        with self._changed:
            self._wake = self._newcomer = True
            self._changed.notify_all()

    def _woken(self) -> None:
        with self._changed:
            self._wake = True
            self._changed.notify_all()

    def _work(self) -> None:
        last: Optional[List[Marker]] = None
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._wake or self._ended)
                if self._ended:
                    return
                newcomer, self._wake, self._newcomer = self._newcomer, False, False
            self._feed.take()
            if not self._topic.get_num_connections():
                continue
            drawn = markers(self._state.tree.snapshot()[1], self._frame)
            if newcomer or drawn != last:
                last = drawn
                self._topic.publish(MarkerArray(drawn))
