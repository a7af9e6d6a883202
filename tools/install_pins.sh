#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs the pinned packages of a profile (requirements*.txt) with the pip of .venv. What has no wheel that fits this
# Python and its numpy is built from source.
#   install_pins.sh PROFILE          into .venv
#   install_pins.sh PROFILE FOLDER   into a folder, with all that they need, also what this machine has
set -euo pipefail
cd "$(dirname "$0")/.."
workspace=$PWD profile=$1 folder=${2:-}

fail() { echo "build: $*" >&2; exit 1; }
say() { echo "build: $*"; }

log=.venv/pip.log
install=".venv/bin/pip --disable-pip-version-check install"
# A second call replaces what the first one has put into the folder.
[ -z "$folder" ] || install+=" --target $folder --no-compile --upgrade"
export PIP_ROOT_USER_ACTION=ignore

# pybullet has no wheel for Python 3.13, and its C is older than the errors of gcc 14. Built once, with the numpy that
# is installed, without which its pictures come as lists.
build_pybullet() {
  local wanted=$1 temporary=$workspace/.venv/tmp shown=0 done builder
  say "$wanted has no wheel for this Python: it is built from source, which takes some minutes"
  rm -rf "$temporary"
  mkdir "$temporary"
  TMPDIR=$temporary CFLAGS="-Wno-incompatible-pointer-types -Wno-int-conversion -Wno-implicit-function-declaration -fpermissive -g0 -w" \
    $install -v --no-deps --no-build-isolation --no-binary pybullet "$wanted" >.venv/pybullet.log 2>&1 &
  builder=$!
  while kill -0 $builder 2>/dev/null; do
    # pip removes folders meanwhile, which find calls an error.
    done=$({ find "$temporary" -name '*.o' 2>/dev/null || true; } | wc -l)
    if [ "$done" -ge $((shown + 25)) ]; then
      say "pybullet: $done files compiled"
      shown=$done
    fi
    sleep 1
  done
  wait $builder || {
    tail -n 5 .venv/pybullet.log >&2
    fail "pip could not build $wanted (network?); the whole log is $workspace/.venv/pybullet.log"
  }
  rm -rf "$temporary"
}

wanted=$(tools/packages.sh requirements.txt "$profile")
nodeps=$(tools/packages.sh requirements-nodeps.txt "$profile")
pybullet=$(grep '^pybullet' <<<"$wanted" || true)
[ -z "$pybullet" ] || $install -q --no-deps --only-binary :all: "$pybullet" 2>$log || build_pybullet "$pybullet"
$install -q -c .venv/constraints.txt -r <(grep -v '^pybullet' <<<"$wanted") 2>$log &&
  $install -q --no-deps -r <(echo "$nodeps") 2>>$log &&
  # Its wheels are compiled for a newer numpy than that of Debian 11 and Ubuntu 20.04.
  { PYTHONPATH=$folder .venv/bin/python -c 'import pyastar2d' 2>/dev/null ||
    $install -q --no-deps --no-build-isolation --force-reinstall --no-binary pyastar2d \
      -r <(grep '^pyastar2d' <<<"$nodeps") 2>>$log; } || {
  tail -n 5 $log >&2
  fail "pip could not install the packages of requirements.txt (network? a Python that docs/platforms.md does not have?)"
}
