#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a command in the built workspace: virtual environment active, devel space sourced.
set -e
workspace=$(cd "$(dirname "$0")/.." && pwd)
[ -e "$workspace/devel/setup.bash" ] || { echo "in_workspace: not built yet; run 'make build'" >&2; exit 1; }
. "$workspace/.venv/bin/activate"
set +u
command=("$@")
set --   # catkin's script takes the arguments of its caller for its own, --help for one
. "$workspace/devel/setup.bash"
# What runs on one machine does not need its names (merlin/local_names.py does the same for a single run).
has_address() { getent ahosts "$1" >/dev/null; }
name=$(uname -n)
if [ -z "${ROS_IP:-}${ROS_HOSTNAME:-}" ] && ! has_address "$name"; then
  export ROS_IP=127.0.0.1
  echo "in_workspace: '$name' cannot be resolved, 127.0.0.1 is used; plain roslaunch needs the line '127.0.1.1 $name' in /etc/hosts" >&2
fi
master=${ROS_MASTER_URI:-http://localhost:11311}
case $master in
  http://localhost:*) has_address localhost || export ROS_MASTER_URI="${master/localhost/127.0.0.1}" ;;
esac
exec "${command[@]}"
