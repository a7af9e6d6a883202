#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes a Debian package of the install space of a profile: make deb PROFILE=robot
#   PROFILE=robot|simulation|all   with +fleet too (tools/packages.sh); all when none is given
# It is for the Debian and the processor of this machine. Debian's packages are its dependencies; those of pip lie in it.
# What the checkout has built, which may be a larger profile, is not touched.
set -euo pipefail
cd "$(dirname "$0")/.."

fail() { echo "deb: $*" >&2; exit 1; }

profile=$(tools/packages.sh --largest "${PROFILE:-all}") || exit 2
command -v dpkg-deb >/dev/null || fail "it needs dpkg-deb; take Debian 12 or 13"
[ -z "$(tools/packages.sh --ros)" ] || fail "it is made for Debian's ROS; here is that of $(tools/packages.sh --ros)"
prefix=/opt/merlin
name=merlin-${profile//+/-}
build=$PWD/build/deb/$profile
root=$build/root
library=$root$prefix/lib/python3/dist-packages
left_out=$(tools/packages.sh --left-out "$profile")
# The link src/extras may be there for a larger profile of this checkout.
[ -n "$(tools/packages.sh --extras "$profile")" ] || left_out+=" $(ls extras)"
[ -n "$(tools/packages.sh --examples "$profile")" ] || left_out+=" $(ls examples)"
rm -rf "$root"
mkdir -p "$build/work" "$root/DEBIAN" "$root/usr/share/doc/$name" "$library"

# Run by Debian's Python: the virtual environment is not taken along.
unset CMAKE_PREFIX_PATH PYTHONPATH ROS_PACKAGE_PATH
export ROS_LANG_DISABLE=geneus:genlisp:gennodejs:gencpp
[ -e src/CMakeLists.txt ] || catkin_init_workspace src >/dev/null
cmake -S src -B "$build/work" -DCMAKE_INSTALL_PREFIX=$prefix -DCATKIN_DEVEL_PREFIX="$build/devel" -DPYTHON_EXECUTABLE=/usr/bin/python3 \
  -DCATKIN_ENABLE_TESTING=OFF -DCATKIN_BLACKLIST_PACKAGES="${left_out// /;}" >"$build/log" 2>&1 &&
  DESTDIR=$root make -C "$build/work" -j"$(nproc)" install >>"$build/log" 2>&1 || {
  tail -n 5 "$build/log" >&2
  fail "the build failed; the whole log is $build/log"
}
# numpy is Debian's, as in build.sh.
tools/install_pins.sh "$profile" "$library" || exit 1
rm -rf "$library"/numpy "$library"/numpy.libs "$library"/numpy-*.dist-info "$library/bin"
# pybullet's wheel has debugging symbols, data and examples: 270 MB that nothing here uses.
rm -rf "$library"/pybullet_{data,envs,examples,robots}
find "$library" -maxdepth 1 -name 'pybullet.*.so' -exec strip --strip-unneeded {} +
# Nothing is compiled on the robot, so nothing is left there when the package is removed.
find "$root" -name __pycache__ -prune -exec rm -rf {} +
/usr/bin/python3 -m compileall -q --invalidation-mode unchecked-hash -s "$root" -p / "$root$prefix" >/dev/null || true

python=$(/usr/bin/python3 -c 'import sys; print("python3 (>= %d.%d), python3 (<< %d.%d)" % (*sys.version_info[:2], sys.version_info[0], sys.version_info[1] + 1))')
version=$(sed -n 's:.*<version>\(.*\)</version>.*:\1:p' src/merlin/package.xml)
commit=$(git log -1 --date=format:%Y%m%d%H%M --format=+%cd.%h 2>/dev/null || true)
cp LICENSE "$root/usr/share/doc/$name/copyright"
cat >"$root/DEBIAN/control" <<END
Package: $name
Version: $version$commit
Architecture: $(dpkg --print-architecture)
Maintainer: $(sed -n 's:.*<maintainer email="\(.*\)">\(.*\)</maintainer>.*:\2 <\1>:p' src/merlin/package.xml)
Installed-Size: $(du -sk "$root" | cut -f1)
Depends: $python, $(tools/packages.sh --run-time apt.txt "$profile" | paste -sd, | sed 's/,/, /g')
Recommends: alsa-utils
Provides: merlin
Conflicts: merlin
Replaces: merlin
Section: science
Priority: optional
Description: MERLIN, a hybrid cognitive architecture for service robots on ROS 1
 Profile $profile, in $prefix: source $prefix/setup.bash, then rosrun merlin doctor.
END
chmod -R u=rwX,go=rX "$root"
file=results/deb/${name}_$version${commit}_$(dpkg --print-architecture).deb
mkdir -p results/deb
rm -f results/deb/"${name}"_*.deb
dpkg-deb --root-owner-group -Zxz -z1 --build "$root" "$file" >/dev/null
rm -rf "$root"
echo "deb: $file, $(du -m "$file" | cut -f1) MB; install it with: apt install ./$file"
