"""An alarm rings again after a callback that failed."""

import queue

import rospy

from merlin_rosplan.transport.ros_alarm import RosAlarm

LONG = 60.0


def test_a_callback_that_fails_does_not_end_the_alarm(monkeypatch):
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    monkeypatch.setattr(rospy, "logerr", lambda text, *values: told.put(text % values))
    rospy.rostime.switch_to_wallclock()
    told, rung = queue.Queue(), queue.Queue()

    def ring():
        rung.put(True)
        raise RuntimeError("broken bell")

    alarm = RosAlarm(ring, "alarm of a test")
    try:
        for moment in (1.0, 2.0):  # long past
            alarm.set(moment)
            assert rung.get(timeout=LONG)
            assert "broken bell" in told.get(timeout=LONG)
    finally:
        alarm.shutdown()
