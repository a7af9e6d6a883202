#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Says what a profile needs. Profiles contain each other: robot, simulation (and the simulator), all (and fleet, tests, lint).
# robot+fleet and simulation+fleet have the fleet, too; +deliberation behind any of them adds pyrobosim (docs/deliberation.md).
#   packages.sh FILE [PROFILE]       the lines of apt.txt or requirements*.txt that it needs; all: every one. A section is of
#                                    the profile in brackets at the end of its title; without one, of each. Sections of ROS
#                                    are left out where another ROS 1 is installed, whose files theirs would lie beside.
#   packages.sh --run-time FILE PROFILE   the same without sections whose title has the word building
#   packages.sh --largest PROFILE …  the smallest that has all of them; exit code 2 when one is none
#   packages.sh --left-out PROFILE   the catkin packages below src that are not built
#   packages.sh --extras PROFILE     yes: packages below extras are built
#   packages.sh --examples PROFILE   yes: those below examples are built; all has them, too, without pyrobosim
#   packages.sh --ros                the prefix of that other ROS; nothing: ROS is Debian's
#   OPT_ROS=/opt/ros   the folder where ROS One and Noetic install
set -euo pipefail
cd "$(dirname "$0")/.."

SIMULATION="merlin_sim merlin_experiment merlin_restaurant merlin_guests"
ALL="merlin_test"

rank() {
  case ${1%+deliberation} in
  robot | robot+fleet) echo 1 ;;
  simulation | simulation+fleet) echo 2 ;;
  all) echo 3 ;;
  *)
    echo "build: PROFILE=$1 is not one of robot, simulation, robot+fleet, simulation+fleet, all; +deliberation may follow" >&2
    exit 2
    ;;
  esac
}

largest() {
  local profile found=robot most=1 rank fleet= deliberation=
  for profile in "$@"; do
    rank=$(rank "$profile")
    ! has_deliberation "$profile" || deliberation=+deliberation
    profile=${profile%+deliberation}
    [ "$rank" -le $most ] || { found=${profile%+fleet} most=$rank; }
    ! has_fleet "$profile" || fleet=+fleet
  done
  [ "$found" = all ] || found+=$fleet
  echo "$found$deliberation"
}

has_fleet() { case ${1%+deliberation} in all | *+fleet) ;; *) false ;; esac; }
has_deliberation() { case $1 in *+deliberation) ;; *) false ;; esac; }

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

case ${1:-} in
--ros) foreign_ros ;;
--largest) largest "${@:2}" ;;
--left-out)
  case $(largest "${2:-all}") in
  robot*) echo "$SIMULATION $ALL" ;;
  simulation*) echo "$ALL" ;;
  esac
  ;;
--extras) ! has_fleet "$(largest "$2")" || echo yes ;;
--examples) case $(largest "$2") in all* | *+deliberation) echo yes ;; esac ;;
*)
  running=
  [ "${1:-}" != --run-time ] || { running=yes && shift; }
  wanted=$(rank "${2:-all}")
  fleet=$(! has_fleet "${2:-all}" || echo yes)
  deliberation=$(! has_deliberation "${2:-all}" || echo yes)
  awk -v without="$(foreign_ros)" -v wanted="$wanted" -v fleet="$fleet" -v deliberation="$deliberation" -v running="$running" '
    /^# ---/ {ros = $3 == "ROS"; building = /building/; rank = /\[deliberation\]/ && !deliberation ? 4 : /\[all\]/ || (/\[fleet\]/ && !fleet) ? 3 : /\[simulation\]/ ? 2 : 1}
    !/^#/ && NF && !(ros && without) && !(building && running) && rank <= wanted' "$1"
  ;;
esac
