#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs the README's commands in a bare root of a Debian release: make debian VERSION=13
#   VERSION=13            12 or 11
#   TARGET="build demo"   targets of make that are run one after the other; test: all tests, and PYTEST="FILE …": these;
#                         check with ALL=1: all unit tests
#   DEB=FILE              a package that make deb has made, which is installed instead, tried and removed again
#   PROFILE=robot         of the build: robot, simulation, all, robot+fleet …; each target asks for what it needs
#   AS=user               in the home of an ordinary user who may use sudo; root
#   MIRROR=…              of Debian, http://deb.debian.org/debian
#   FOLDER=/tmp           where the root is made: about 6 GB, removed at the end, also after an error and Ctrl-C
# What is committed is run: the root gets a clone. All that is mounted for it is mounted in a namespace of its own, which
# ends with its last process; so nothing is mounted when the root is removed, and no process of it is left.
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "debian: $*" >&2; exit 1; }
say() { echo "debian: $*"; }

case ${VERSION:-13} in
11) release=bullseye ;;
12) release=bookworm ;;
13) release=trixie ;;
*) fail "VERSION=$VERSION is not 11, 12 or 13" ;;
esac
case ${AS:-root} in
root) home=/root packages=git,make,ca-certificates ;;
user) home=/home/user packages=git,make,ca-certificates,sudo ;;
*) fail "AS=$AS is not root or user" ;;
esac

# Second half: inside the namespaces, as their first process.
if [ "${1:-}" = --inside ]; then
  root=$2
  mount -t proc proc "$root/proc"
  mount -t devpts -o newinstance,ptmxmode=0666,mode=620 devpts "$root/dev/pts"
  ln -sf pts/ptmx "$root/dev/ptmx"
  mount -t tmpfs -o mode=1777 tmpfs "$root/dev/shm"
  inside() {
    chroot --userspec="$account" "$root" /usr/bin/env -i HOME="$home" USER="$account" LANG=C.UTF-8 \
      TERM="${TERM:-dumb}" DEBIAN_FRONTEND=noninteractive \
      PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin \
      http_proxy="${http_proxy:-}" https_proxy="${https_proxy:-}" no_proxy="${no_proxy:-}" "$@"
  }
  account=root
  inside update-ca-certificates >/dev/null 2>&1
  if [ "$home" != /root ]; then
    inside useradd --create-home --shell /bin/bash user
    inside sh -c 'echo "user ALL=(ALL:ALL) NOPASSWD: ALL" >/etc/sudoers.d/user'   # as an installed Debian, without the password
    inside mv /root/merlin "$home/merlin"
    inside chown -R user:user "$home/merlin"
    account=user
  fi
  size() { echo "$(dpkg --root="$root" -l | grep -c '^ii') Debian packages, $(du -xsm "$root" | cut -f1) MB"; }
  say "the bare root: $(size)"
  SECONDS=0
  if [ -n "${DEB:-}" ]; then
    package=$(dpkg-deb -f "$root/root/merlin.deb" Package)
    inside apt-get update -q >/dev/null
    inside apt-get install -y -q --no-install-recommends /root/merlin.deb >"$root/root/log" 2>&1 || {
      tail -n 5 "$root/root/log" >&2
      fail "apt-get could not install $DEB"
    }
    say "$package is installed: $SECONDS s since the bare root, $(size)"
    inside useradd --create-home --shell /bin/bash robot
    chmod 755 "$root/root"
    home=/home/robot account=robot
    inside /root/merlin/tools/try_installed.sh
    home=/root account=root
    inside apt-get purge -y -q "$package" >/dev/null 2>&1
    left=$(find "$root"/opt/* "$root/usr/share/doc/$package" "$root"/var/lib/dpkg/info/"$package".* 2>/dev/null | head -n 3 || true)
    [ -z "$left" ] || fail "$package has left $left"
    say "$package is removed"
    exit 0
  fi
  for target in ${TARGET:-build demo}; do
    say "Debian ${VERSION:-13}: make $target, as $account"
    if [ "$target" = test ] && [ -n "${PYTEST:-}" ]; then
      inside make -s -C "$home/merlin" build
      # shellcheck disable=SC2086
      inside sh -c 'cd ~/merlin && exec tools/in_workspace.sh python -m pytest -q "$@"' sh $PYTEST
      continue
    fi
    inside make -s -C "$home/merlin" LINGER=false ${PROFILE:+PROFILE="$PROFILE"} ${ALL:+ALL="$ALL"} "$target"   # no key is waited for between two targets
    say "make $target: $SECONDS s since the bare root, $(size)"
  done
  exit 0
fi

[ -z "${DEB:-}" ] || dpkg-deb -f "$DEB" Package >/dev/null 2>&1 || fail "DEB=$DEB is not a Debian package; make deb makes one"
[ "$(id -u)" = 0 ] || exec sudo --preserve-env=VERSION,TARGET,PROFILE,ALL,DEB,PYTEST,AS,MIRROR,FOLDER,http_proxy,https_proxy,no_proxy "$0"
for tool in debootstrap unshare git pkill; do
  command -v "$tool" >/dev/null || fail "it needs $tool: apt-get install debootstrap util-linux git procps"
done
workspace=$PWD
root=$(mktemp -d "${FOLDER:-/tmp}/merlin-debian-${VERSION:-13}.XXXXXX")
chmod 755 "$root"   # the user's / in there
child=
remove() {
  trap '' INT TERM HUP
  # The namespaces end with their first process, the child of unshare: the kernel ends all others in them, and unmounts,
  # before unshare hears of that end.
  if [ -n "$child" ]; then
    pkill -KILL -P "$child" || kill -KILL "$child" 2>/dev/null || true
    wait "$child" 2>/dev/null || true
  fi
  if grep -q " $root/" /proc/self/mountinfo; then
    fail "$root is left, because something is mounted in it"
  fi
  say "removing $root"
  rm -rf --one-file-system -- "$root"
}
trap remove EXIT
trap 'rm -f "$root.log"; exit 130' INT
trap 'rm -f "$root.log"; exit 143' TERM
trap 'rm -f "$root.log"; exit 129' HUP

# In the background with a wait, because bash would otherwise act on a signal only when the command has ended.
attended() { "$@" & child=$!; wait "$child"; child=; }

say "Debian ${VERSION:-13} ($release) in $root"
attended unshare --mount --pid --fork --kill-child --propagation private \
  sh -c 'exec "$@" >"$0" 2>&1' "$root.log" debootstrap --variant=minbase --include="$packages" \
  "$release" "$root" "${MIRROR:-http://deb.debian.org/debian}" || {
  tail -n 5 "$root.log" >&2
  fail "debootstrap failed (network? MIRROR?); the whole log is $root.log"
}
rm -f "$root.log"
# What this machine needs to reach the network; nothing else of it is seen in there.
cp -L /etc/resolv.conf /etc/hosts "$root/etc/"
find /usr/local/share/ca-certificates -name '*.crt' -exec cp -t "$root/usr/local/share/ca-certificates" {} + 2>/dev/null || true
[ -z "$(git status --porcelain)" ] || say "what is not committed is left out"
git clone -q --no-local --no-tags "$workspace" "$root/root/merlin"
[ -z "${DEB:-}" ] || cp "$DEB" "$root/root/merlin.deb"
attended unshare --mount --pid --fork --kill-child --propagation private "$workspace/tools/debian.sh" --inside "$root"
say "Debian ${VERSION:-13}: ${DEB:-${TARGET:-build demo}} passed"
