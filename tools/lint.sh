#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# ruff, mypy, vermin (nothing newer than Python 3.8), the map of imports, tests that assert nothing, catkin_lint on all packages, roslaunch-check on all launch files.
# Ends non-zero at any finding.
#   --changed-launch-files [REVISION]   roslaunch-check only where a launch file or manifest has changed since
set -u
cd "$(dirname "$0")/.."
status=0
ruff check . || status=1
ruff format --check . || status=1
python tools/check_imports.py || status=1
python tools/check_tests.py || status=1
mypy || status=1
vermin --target=3.8- --violations --no-tips --quiet --exclude-regex '\.j2$' src extras examples bench || status=1
python tools/application_lines.py --check || status=1
catkin_lint -q -W2 --strict src extras examples || status=1
if [ "${1:-}" = --changed-launch-files ]; then
  since=${2:-$(git merge-base HEAD '@{upstream}' 2>/dev/null || echo HEAD)}
  { git diff --name-only "$since"; git ls-files --others --exclude-standard; } |
    grep -qE '\.launch$|package\.xml$|CMakeLists\.txt$' || exit $status
fi
# launch/ is linked into the package merlin; roslaunch-check follows links and then finds no package, so it gets a
# copy of the package as it would be installed. -t: what only some launch files need is a test_depend of its manifest.
copy=$(mktemp -d)   # and no workspace is named, because catkin would lead back to the link
trap 'rm -rf "$copy"' EXIT
cp -rL src/merlin "$copy/merlin"
# rviz is optional, and its launch file refuses to be read without it: here it is not started, a stand-in does.
mkdir "$copy/bin" && ln -s /bin/true "$copy/bin/rviz"
while IFS= read -r file; do
  PATH=$PATH:$copy/bin DISPLAY=${DISPLAY:-:0} CMAKE_PREFIX_PATH="" ROS_HOME=$copy/ros ROS_PACKAGE_PATH=$copy:$ROS_PACKAGE_PATH rosrun roslaunch roslaunch-check -i -t "$file" \
    >"$copy/report" 2>&1 || { echo "${file#"$copy/"}:"; cat "$copy/report"; status=1; }
done < <(find "$copy/merlin/launch" src/underlay -name '*.launch' | sort)
exit $status
