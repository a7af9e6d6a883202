#!/usr/bin/env bash
# Runs a command in the built workspace: virtual environment active, devel space sourced.
set -e
workspace=$(cd "$(dirname "$0")/.." && pwd)
[ -e "$workspace/devel/setup.bash" ] || { echo "in_workspace: not built yet; run 'make build'" >&2; exit 1; }
. "$workspace/.venv/bin/activate"
set +u
command=("$@")
set --   # catkin's script takes the arguments of its caller for its own, --help for one
. "$workspace/devel/setup.bash"
exec "${command[@]}"
