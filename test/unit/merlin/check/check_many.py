# SPDX-License-Identifier: Apache-2.0
"""Checks one application after the other in this process.

Each line of standard input is a JSON list: a folder of Python modules, and the words of `merlin check`.
With `--at-start` it says what it says beside a run.
Each line of standard output is another: exit code, standard output, standard error. An empty line ends it.
"""

import contextlib
import io
import json
import os
import sys
from typing import List

from merlin.check import report
from merlin.launch_config import LaunchConfig
from merlin.launch_request import LaunchError, LaunchRequest
from merlin.local_names import master_uri, use_loopback
from merlin.master import Master
from merlin_ros.node import end_node, init_node


def checked(folder: str, words: List[str]) -> list:
    out, err = io.StringIO(), io.StringIO()
    sys.path.insert(0, folder)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            at_start = "--at-start" in words
            request = LaunchRequest.from_command_line([word for word in words if word != "--at-start"])
            code = report(request.launch_file.name, LaunchConfig(request), at_start)
        except LaunchError as error:
            code = 2
            print(error, file=err)
    sys.path.remove(folder)
    for name, module in list(sys.modules.items()):
        if (getattr(module, "__file__", None) or "").startswith(f"{folder}{os.sep}"):
            del sys.modules[name]  # the next folder may have one of the same name
    return [code, out.getvalue(), err.getvalue()]


use_loopback()
master = Master()
os.environ["ROS_MASTER_URI"] = master_uri(master.port)
init_node("check_many", anonymous=True)
try:
    for line in iter(sys.stdin.readline, "\n"):
        print(json.dumps(checked(*json.loads(line))), flush=True)
finally:
    end_node("checked")
    master.stop()
