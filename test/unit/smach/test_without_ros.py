# SPDX-License-Identifier: Apache-2.0
"""The pure-Python smach needs no ROS."""

import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).parents[3] / "src" / "underlay" / "smach" / "src"
PROGRAM = """
import sys
sys.path.insert(0, {source!r})
import smach

class A(smach.State):
    def __init__(self):
        smach.State.__init__(self, outcomes=["done"])
    def execute(self, ud):
        return "done"

sm = smach.StateMachine(outcomes=["done"])
with sm:
    smach.StateMachine.add("A", A())
assert sm.execute() == "done"
alien = [name for name in sys.modules if name.split(".")[0] in ("rospy", "genpy", "roslib", "smach_ros")]
assert not alien, alien
for module in ("state", "container", "state_machine", "user_data", "util", "exceptions"):
    assert hasattr(smach, module), module
"""


def test_smach_imports_and_works_without_ros():
    # -I: neither PYTHONPATH nor the user's packages.
    program = PROGRAM.format(source=str(SOURCE))
    done = subprocess.run([sys.executable, "-I", "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
