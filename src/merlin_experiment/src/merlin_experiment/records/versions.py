# SPDX-License-Identifier: Apache-2.0
"""What software ran, for the records."""

import platform
from importlib import metadata

import rospkg

DISTRIBUTIONS = ("kairos-planner", "pybullet", "pyastar2d", "numpy")


def versions() -> str:
    """MERLIN, Python and the libraries that results depend on, in one line."""
    merlin = rospkg.RosPack().get_manifest("merlin_experiment").version
    parts = [f"merlin {merlin}", f"python {platform.python_version()}"]
    return "; ".join([*parts, *(f"{name} {_installed(name)}" for name in DISTRIBUTIONS)])


def _installed(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "-"
