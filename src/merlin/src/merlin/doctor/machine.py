# SPDX-License-Identifier: Apache-2.0
"""What this computer has, for the doctor."""

import importlib.util
import os
import shutil
import socket
import sys
import tempfile
from pathlib import Path
from typing import List

import rosgraph
import rospkg
from rosgraph.network import parse_http_host_and_port

from merlin.doctor.findings import Machine
from merlin.launch_request import LaunchError, launch_folder
from merlin.local_names import given_address, is_own, resolves
from merlin_pddl.checks import installed_planners, kairos_check

#: What a robot's computer has to have.
MODULES = ("rospy", "actionlib", "tf2_ros", "smach", "merlin_msgs", "merlin_sm", "merlin_rosplan", "numpy")
SOUND = Path("/dev/snd")
PATIENT_TCP = Path("/proc/sys/net/ipv4/tcp_rto_max_ms")


def look_at_machine() -> Machine:
    """Looks at it; starts nothing."""
    host, address = socket.gethostname(), given_address()
    folders = {rospkg.get_ros_home(), rospkg.get_log_dir()}
    try:
        master, _ = parse_http_host_and_port(rosgraph.get_master_uri())
    except ValueError:
        master = ""
    return Machine(
        python=sys.version_info[:2],
        missing=[name for name in MODULES if importlib.util.find_spec(name) is None],
        packages=package_fault(),
        planner=kairos_check.available() or installed_planners.stand_in() is not None,
        free={folder: free_space(Path(folder)) for folder in folders},
        host=host,
        host_resolves=resolves(host),
        address=address,
        address_is_own=not address or is_own(address.partition("=")[2]),
        master=master or "",
        master_is_elsewhere=bool(master) and not is_own(master),
        sound=sound_fault(SOUND),
        patient_tcp=PATIENT_TCP.exists(),
    )


def package_fault() -> str:
    """Why ROS does not find the package merlin, with what to do; empty: it does."""
    try:
        launch_folder()
    except LaunchError as error:
        return str(error)
    return ""


def free_space(folder: Path) -> int:
    """MB that are free for a folder, which need not exist yet; -1: it cannot be written."""
    try:
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
        with tempfile.TemporaryFile(dir=str(folder)):
            return shutil.disk_usage(str(folder)).free // 2**20
    except OSError:
        return -1


def sound_fault(devices: Path) -> str:
    """Why this user hears nothing from this computer, with what to do; empty: nothing is known against it.

    :param devices: the folder of the sound devices, /dev/snd.
    """
    missing: List[str] = [name for name in ("espeak-ng", "aplay") if shutil.which(name) is None]
    cards = sorted(devices.glob("pcm*p"))
    if missing:
        return f"nothing can be heard: no {' and no '.join(missing)}; apt install espeak-ng alsa-utils"
    if not cards:
        return "there is no sound device; speech is silent here"
    if not any(os.access(str(card), os.W_OK) for card in cards):
        return f"this user may not use {cards[0]}; add him to the group audio: sudo usermod -aG audio $USER"
    return ""
