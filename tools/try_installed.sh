#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A mission on simulated action servers where /opt/merlin is installed and nothing else of MERLIN: what a robot's computer
# runs, without its robot. Where the simulator is installed, Mission 1 in it, too, whose page answers meanwhile.
# Ends with 0 when the goals hold. For an ordinary user; needs nothing of the checkout.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
export ROS_HOME=$folder/ros
set +u
. /opt/merlin/setup.bash
set -u
rosrun merlin doctor
cat >points.yaml <<'END'
points_of_interest:
  kitchen: {x: 1.0, y: 2.0, yaw: 0.0}
  bathroom: {x: 3.0, y: 2.0, yaw: 0.0}
  dorm_room: {x: 1.0, y: 4.0, yaw: 0.0}
  main_door: {x: 3.0, y: 4.0, yaw: 0.0}
END
cat >installed_round.py <<'END'
from merlin_executor.mission import GoalDispatcher


class Round(GoalDispatcher):
    def run(self):
        self.achieve("(checked kitchen)")
        self.achieve("(checked bathroom)")
END
cat >round.launch <<'END'
<launch>
  <include file="$(find merlin)/launch/include/application.launch" pass_all_args="true">
    <arg name="world_file" value="$(dirname)/points.yaml"/>
    <arg name="answers" value="['yes']"/>
  </include>
  <node pkg="merlin_executor" type="mission" name="mission" output="screen" required="true" args="mission:=installed_round:Round"/>
</launch>
END
rosrun merlin unit round.launch on:=robot
PYTHONPATH=$folder:$PYTHONPATH rosrun merlin run round.launch on:=servers
[ -d /opt/merlin/share/merlin_sim ] || exit 0
python3 - <<'END'
import subprocess
import sys
import urllib.request

command = ["rosrun", "merlin", "run", "home.launch", "rtf:=3", "linger:=false"]
with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as demo:
    for line in demo.stderr:
        print(line, end="", flush=True)
        if line.startswith("monitor: http"):
            with urllib.request.urlopen(line.split()[1], timeout=120.0) as page:
                print(f"the page answers with {len(page.read())} bytes", flush=True)
sys.exit(demo.returncode)
END
