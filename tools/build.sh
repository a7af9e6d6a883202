#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Prepares the workspace from a bare machine: apt packages, virtual environment, catkin build.
# Each step is skipped when it has nothing to do, so a second call costs seconds.
#   build.sh [NEEDED]        a profile that the caller needs
#   build.sh --without-catkin [NEEDED]   all but the catkin build, which a Debian package has of its own
#   PROFILE=robot|simulation|all   what is asked for, robot+fleet and simulation+fleet too, +deliberation behind each (tools/packages.sh); neither: all
#   UNDERLAY=auto|all|none   which underlay packages to build (tools/underlay.py)
set -euo pipefail
cd "$(dirname "$0")/.."
workspace=$PWD

fail() { echo "build: $*" >&2; exit 1; }
say() { echo "build: $*"; }

# The first lines of scripts, catkin and lists of folders cannot hold such a path, and fail with other words, minutes later.
case $workspace in
*[[:space:]:\;\"\'\`\$\&\(\)#%\\]*) fail "the path '$workspace' has a blank, or another character that catkin cannot use; move the workspace to a path of letters, digits, '-', '_' and '.'" ;;
esac

as_root() {
  if [ "$(id -u)" = 0 ]; then env DEBIAN_FRONTEND=noninteractive "$@"
  elif command -v sudo >/dev/null; then
    # sudo forgets how this user reaches the network.
    sudo env DEBIAN_FRONTEND=noninteractive ${http_proxy:+http_proxy="$http_proxy"} \
      ${https_proxy:+https_proxy="$https_proxy"} ${no_proxy:+no_proxy="$no_proxy"} "$@"
  else fail "'$*' needs root: install sudo or run it once as root"; fi
}

install_apt() {
  local wanted missing
  wanted=$(tools/packages.sh apt.txt "$profile")
  # shellcheck disable=SC2086
  missing=$(comm -13 \
    <(dpkg-query -W -f '${db:Status-Abbrev} ${Package}\n' $wanted 2>/dev/null | awk '$1 == "ii" {print $2}' | sort -u) \
    <(tr -s ' \n' '\n' <<<"$wanted" | sed '/^$/d' | sort -u))
  [ -z "$missing" ] && return
  say "installing $(wc -w <<<"$missing") Debian packages"
  [ -z "$ros" ] || say "ROS is that of $ros: Debian's packages of ROS are left out"
  local log=$workspace/.apt.log
  as_root apt-get update -q >"$log" 2>&1 || true   # an old list may do; the install decides
  # shellcheck disable=SC2086
  as_root apt-get install -y -q -o DPkg::Lock::Timeout=300 --no-install-recommends $missing 2>&1 | tee -a "$log" |
    sed -un '0,/^Waiting for cache lock/s/^Waiting for cache lock.*held by \(.*[^.]\)\.*$/build: waiting, 300 s at most, until \1 has installed its packages/p' || {
    tail -n 5 "$log" >&2
    fail "apt-get could not install the packages of apt.txt (network? Debian 12 or 13?); the whole log is $log"
  }
  rm -f "$log"
}

make_venv() {
  local python=/usr/bin/python3 stamp=.venv/.requirements key numpy
  local alone='import site; site.ENABLE_USER_SITE = False'
  # The Python of a conda environment with ROS is the one that can import it.
  case $ros/ in "${CONDA_PREFIX:-/none}"/*) python=$CONDA_PREFIX/bin/python3 ;; esac
  # cv_bridge and OpenCV are built for this numpy.
  numpy=$("$python" -s -c 'import numpy; print("numpy==" + numpy.__version__)') || fail "$python has no numpy"
  key=$({
    echo "$python $numpy $alone"
    tools/packages.sh requirements.txt "$profile"
    tools/packages.sh requirements-nodeps.txt "$profile"
  } | sha256sum)
  [ -x .venv/bin/python ] && [ "$(cat $stamp 2>/dev/null)" = "$key" ] && return
  say "virtual environment .venv"
  [ -x .venv/bin/python ] || "$python" -m venv --system-site-packages .venv
  # What the user has for himself in ~/.local would otherwise come before Debian's packages: another numpy, for one.
  find .venv/lib -path '*/python3*/site-packages' -prune -exec sh -c 'echo "$1" >"$2/_without_user_site.pth"' sh "$alone" {} \;
  echo "$numpy" >.venv/constraints.txt
  tools/install_pins.sh "$profile" || exit 1
  echo "$key" >$stamp
}

choose_packages() {
  # shellcheck disable=SC1091
  . .venv/bin/activate
  python tools/underlay.py "${UNDERLAY:-auto}" || exit 1
  # The user's own overlays stay below this workspace; without one, Debian's prefix is all there is.
  local setup
  for setup in /opt/ros/*/setup.sh; do
    # shellcheck disable=SC1090
    if [ -z "${CMAKE_PREFIX_PATH:-}" ] && [ -e "$setup" ]; then set +u; . "$setup"; set -u; fi
  done
  # catkin and rospack find packages below src only. The links are not in git: what prepares a release would find a package twice.
  ln -sfn ../test src/merlin_test
  if [ -n "$(tools/packages.sh --extras "$profile")" ]; then ln -sfn ../extras src/extras; else rm -f src/extras; fi
  if [ -n "$(tools/packages.sh --examples "$profile")" ]; then ln -sfn ../examples src/examples; else rm -f src/examples; fi
}

build_catkin() {
  local files key stamp=build/.built
  files=$(find -L src -name CATKIN_IGNORE -o \( -name CMakeLists.txt -o -name package.xml -o -name setup.py -o -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -path '*/scripts/*' \) -type f | grep -v '^src/CMakeLists.txt$' | sort)
  # shellcheck disable=SC2086
  key=$({ echo "$workspace $profile"; cat tools/build.sh; sha256sum $files; } | sha256sum)
  [ "$(cat $stamp 2>/dev/null)" = "$key" ] && [ -e devel/setup.bash ] && return
  say "catkin workspace"
  # Python is what MERLIN speaks; C++ headers stay for the nodes of its users.
  ROS_LANG_DISABLE=${ROS_LANG_DISABLE:-geneus:genlisp:gennodejs} \
    catkin_make -j"$(nproc)" -DCATKIN_BLACKLIST_PACKAGES="$(tools/packages.sh --left-out "$profile" | tr ' ' ';')" \
    -DPYTHON_EXECUTABLE="$workspace/.venv/bin/python" >.catkin.log 2>&1 || {
    grep -nE -A5 'error|Error|FAILED' .catkin.log | head -n 20 >&2
    fail "catkin_make failed; the whole log is $workspace/.catkin.log"
  }
  python -m compileall -q devel/lib/python3*/dist-packages >/dev/null || true
  mkdir -p build && echo "$key" >$stamp
}

# Compiled modules halve the time in which a node starts; Python may have been told not to keep any. Not with catkin's
# build only: a module that was changed since would be compiled anew at each start.
compile_modules() {
  .venv/bin/python -m compileall -q src/*/src extras/*/src examples/*/src src/underlay/*/src >/dev/null || true
}

catkin=yes
[ "${1:-}" != --without-catkin ] || { catkin= && shift; }
# shellcheck disable=SC2086
asked=$(tools/packages.sh --largest ${1:-} "${PROFILE:-${1:-all}}") || exit 2
mkdir -p build
exec 9>build/.lock
flock 9 2>/dev/null || true    # two targets at once: the second waits for the first's build
# Built so far; what was built is kept, so that two targets do not undo each other's build.
profile=$(tools/packages.sh --largest "$asked" "$(cat build/.profile 2>/dev/null || echo robot)")
[ "$profile" = "$asked" ] || [ -z "${PROFILE:-}" ] || say "this checkout has profile $profile, which has all of $asked"
ros=$(tools/packages.sh --ros)   # prefix of a ROS 1 that is not Debian's; empty: Debian's
install_apt
make_venv
choose_packages
[ -n "$catkin" ] || exit 0
build_catkin
compile_modules
echo "$profile" >build/.profile
