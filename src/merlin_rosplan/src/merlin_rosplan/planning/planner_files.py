# SPDX-License-Identifier: Apache-2.0
"""Files of planners: problems for them, how much they may write, and how much of it is kept."""

import contextlib
import os
import tempfile
from typing import TYPE_CHECKING, Optional

if TYPE_CHECKING:  # nodes that import this do without at their start
    from pathlib import Path

MEGABYTE = 1024 * 1024
STDOUT, STDERR = "stdout.txt", "stderr.txt"
#: What all files of a planning may have together, of what one may have.
TOGETHER = 2


def too_much(folder: "Path", limit: float) -> Optional[str]:
    """What is too much in a folder, as the end of a sentence; None when nothing is.

    :param limit: MB for one file; 0 means none. Twice as much for all together.
    """
    together = 0
    for path, _, names in os.walk(str(folder)):
        for name in names:
            with contextlib.suppress(OSError):
                size = os.lstat(os.path.join(path, name)).st_size
                together += size
                if limit and size >= limit * MEGABYTE:
                    what = "printed" if name in (STDOUT, STDERR) else f"wrote into {name}"
                    return f"it {what} more than {limit:g} MB (~output_limit)"
    if limit and together > TOGETHER * limit * MEGABYTE:
        return f"its files have more than {TOGETHER * limit:g} MB (~output_limit is {limit:g} MB)"
    return None


def keep(path: "Path", content: str) -> Optional[str]:
    """Writes a file for the user, into a folder that may be new.

    :return: what is wrong if that fails: a planning does not fail for it.
    """
    try:
        path.parent.mkdir(exist_ok=True)
        path.write_text(content, encoding="utf-8")
    except OSError as error:
        return f"cannot write {path}: {error.strerror}"
    return None


def replace_file(path: str, text: str) -> None:
    """Writes a file in one step: a planner that reads the old one is not disturbed.

    :raises OSError, ValueError: it cannot be written; the old one stays.
    """
    folder = os.path.dirname(os.path.abspath(path))
    handle, temporary = tempfile.mkstemp(dir=folder, prefix=".problem", suffix=".pddl")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:  # the disk is full
        with contextlib.suppress(OSError):  # its folder may be gone: that is what is raised
            os.unlink(temporary)
        raise
