#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A new application on simulated action servers, as docs/hello.md makes one: what a robot's computer runs, without its robot.
# Ends with 0 when the goals of its mission hold. Runs in the workspace (tools/in_workspace.sh).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
rosrun merlin new my_robot --action "greet ?p - poi"
cd my_robot_ws
catkin_make -DPYTHON_EXECUTABLE="$(command -v python)" >"$folder/catkin.log" 2>&1 || {
  tail -n 5 "$folder/catkin.log" >&2
  exit 1
}
set +u
set -- # catkin's script takes the arguments of its caller for its own
. devel/setup.bash
rosrun merlin check my_robot my_robot.launch
rosrun merlin run my_robot my_robot.launch on:=servers
