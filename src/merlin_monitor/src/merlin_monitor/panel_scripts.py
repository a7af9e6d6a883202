# SPDX-License-Identifier: Apache-2.0
"""Where the scripts of panels are: files of packages, without ROS."""

import os
import re
from pathlib import Path

import rospkg

_SCRIPT = re.compile(r"package://([A-Za-z0-9_-]+)/(.+\.js)\Z")


def script_file(script: str) -> Path:
    """The file of a script.

    :param script: ``package://<package>/<path>.js``; it may come from a foreign recording.
    :raises ValueError: when it is something else, or the file does not exist.
    """
    match = _SCRIPT.match(script)
    if match is None or ".." in Path(match.group(2)).parts:
        raise ValueError(f"{script!r} is not package://<package>/<path>.js")
    try:
        path = Path(rospkg.RosPack().get_path(match.group(1))) / match.group(2)
    except rospkg.ResourceNotFound as error:
        raise ValueError(f"there is no package {error}") from error
    if not os.path.isfile(path):  # Path.is_file raises for a name that is too long
        raise ValueError(f"there is no file {path}")
    return path
