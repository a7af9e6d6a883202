#!/usr/bin/env bash
# Prints the packages of apt.txt that this machine needs: without those of ROS where another ROS 1 is installed, whose
# files theirs would lie beside.
#   --ros   prints the prefix of that ROS instead; nothing: ROS is Debian's
#   OPT_ROS=/opt/ros   the folder where ROS One and Noetic install
set -euo pipefail
cd "$(dirname "$0")/.."

foreign_ros() {
  local prefix
  local IFS=:
  for prefix in ${CMAKE_PREFIX_PATH:-} ${CONDA_PREFIX:-} "${OPT_ROS:-/opt/ros}"/*; do
    case $prefix/ in /usr/* | "$PWD"/*) continue ;; esac
    # An overlay has packages of its user; only a whole ROS has this one.
    if [ -e "$prefix/share/rospy/package.xml" ]; then
      echo "$prefix"
      return
    fi
  done
}

ros=$(foreign_ros)
if [ "${1:-}" = --ros ]; then
  echo "$ros"
else
  awk -v without="$ros" '/^# ---/ {ros = $3 == "ROS"} !/^#/ && NF && !(ros && without) {print $1}' apt.txt
fi
