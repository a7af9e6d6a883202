# SPDX-License-Identifier: Apache-2.0
"""Checks one folder after the other in this process; prints exit code and output of each as a JSON list."""

import contextlib
import io
import json
import os
import sys
from pathlib import Path

import rospy

from merlin.check import report
from merlin.launch_config import LaunchConfig
from merlin.launch_request import LaunchError, LaunchRequest
from merlin.local_names import master_uri, use_loopback
from merlin.master import Master
from merlin_ros.node import init_node


def checked(folder: Path) -> list:
    out, err = io.StringIO(), io.StringIO()
    sys.path.insert(0, str(folder))
    known = set(sys.modules)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = report(
                "guide.launch", LaunchConfig(LaunchRequest.from_command_line([str(folder / "guide.launch")]))
            )
        except LaunchError as error:
            code = 2
            print(error, file=err)
    sys.path.remove(str(folder))
    for name in set(sys.modules) - known:
        if name.startswith("guide_"):
            del sys.modules[name]
    return [code, out.getvalue(), err.getvalue()]


use_loopback()
master = Master()
os.environ["ROS_MASTER_URI"] = master_uri(master.port)
folders = sys.argv[1:]
sys.argv[1:] = []
init_node("check_many", anonymous=True)
try:
    for folder in folders:
        print(json.dumps(checked(Path(folder))))
finally:
    rospy.signal_shutdown("checked")
    master.stop()
