#!/usr/bin/env bash
# ruff on all Python, catkin_lint on all packages, roslaunch-check on all launch files. Ends non-zero at any finding.
set -u
cd "$(dirname "$0")/.."
status=0
ruff check . || status=1
ruff format --check . || status=1
catkin_lint -q -W2 --strict src || status=1
while IFS= read -r file; do
  rosrun roslaunch roslaunch-check "$file" >/tmp/merlin_lint.$$ 2>&1 || { echo "$file:"; cat /tmp/merlin_lint.$$; status=1; }
done < <(find launch src/underlay -name '*.launch' | sort)
rm -f /tmp/merlin_lint.$$
exit $status
