#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Lint, and beside it the unit tests that a change concerns: tools/check.sh [--all] [--since REVISION]
# A test marked as `processes` starts processes, and is left to make test. Ends non-zero when anything fails.
set -u
cd "$(dirname "$0")/.."
all= since=
while [ $# -gt 0 ]; do
  case $1 in
  --all) all=1 ;;
  --since) since=${2:?--since needs a revision}; shift ;;
  *) echo "check: unknown option '$1'" >&2; exit 2 ;;
  esac
  shift
done
if [ -n "$since" ] && ! git rev-parse -q --verify "$since^{commit}" >/dev/null; then
  echo "check: SINCE=$since is not a revision of this repository" >&2
  exit 2
fi

report=$(mktemp)
trap 'kill $lint 2>/dev/null; rm -f "$report"' EXIT
tools/lint.sh ${all:-"--changed-launch-files" "$since"} >"$report" 2>&1 &
lint=$!
status=0
if [ -n "$all" ]; then
  tests="test/unit test/execution"
else
  tests=$(python tools/affected_tests.py $since) || exit 1
fi
if [ -n "$tests" ]; then
  # One worker per processor; for a few files their start would take longer than the tests.
  workers=0
  [ "$(wc -w <<<"$tests")" -gt 8 ] || [ -n "$all" ] && workers=$(nproc)
  # shellcheck disable=SC2086
  python -m pytest -n $workers --dist loadfile --no-loadscope-reorder --progress -rs \
    -m "not processes and not long" $tests || status=$?
  [ $status != 5 ] || status=0   # all tests of these files start processes
else
  echo "check: the change concerns no unit test"
fi
wait $lint || { status=1; echo "check: lint"; }
cat "$report"
exit $status
