# SPDX-License-Identifier: Apache-2.0
"""Decides which underlay packages this workspace builds.

A group is left out (by an untracked CATKIN_IGNORE) when the machine already has all of its packages
outside this workspace; part of a group counts as nothing, because its packages belong together.
When the set changes, build/ and devel/ are wiped: CMake remembers packages that are gone.

Usage: underlay.py auto|all|none
"""

import glob
import os
import shutil
import sys
from pathlib import Path
from typing import Iterator, List

GROUPS = (
    ("smach", "smach_msgs", "smach_ros"),
    (
        "rosplan_knowledge_msgs",
        "rosplan_dispatch_msgs",
        "rosplan_knowledge_base",
        "rosplan_planning_system",
    ),
    ("sound_play",),
    ("vision_msgs",),
    ("audio_common_msgs",),
)
WORKSPACE = Path(__file__).resolve().parent.parent
UNDERLAY = WORKSPACE / "src" / "underlay"


def foreign(variable: str) -> Iterator[Path]:
    """The folders of a path variable that lie outside this workspace."""
    for text in filter(None, os.environ.get(variable, "").split(os.pathsep)):
        folder = Path(text).resolve()
        if folder != WORKSPACE and WORKSPACE not in folder.parents:
            yield folder


def installed(package: str) -> bool:
    """Whether the machine has the package without this workspace."""
    prefixes: List[Path] = [Path("/usr"), *map(Path, glob.glob("/opt/ros/*"))]
    prefixes += foreign("CMAKE_PREFIX_PATH")
    if any((prefix / "share" / package / "package.xml").exists() for prefix in prefixes):
        return True
    return any(
        found.parent.name == package
        for source in foreign("ROS_PACKAGE_PATH")
        if source != Path("/usr/share")
        for found in source.glob(f"**/{package}/package.xml")
    )


def main() -> int:
    """Writes and removes the CATKIN_IGNORE files; returns the exit code."""
    mode = sys.argv[1] if len(sys.argv) > 1 else "auto"
    if mode not in ("auto", "all", "none"):
        print(f"underlay: UNDERLAY={mode} is not one of auto, all, none", file=sys.stderr)
        return 2
    changed = False
    for group in GROUPS:
        skip = mode == "none" or (mode == "auto" and all(map(installed, group)))
        for package in group:
            mark = UNDERLAY / package / "CATKIN_IGNORE"
            if mark.exists() == skip:
                continue
            changed = True
            if skip:
                mark.write_text("the machine has this package; see tools/underlay.py\n")
                print(f"underlay: {package} is installed on this machine, ours is left out")
            else:
                mark.unlink()
    if changed:
        for folder in ("build", "devel"):
            for entry in (WORKSPACE / folder).glob("*") if (WORKSPACE / folder).exists() else ():
                shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
            # the lock of a running build is kept: its name starts with a dot, and glob passes it over
    return 0


if __name__ == "__main__":
    sys.exit(main())
