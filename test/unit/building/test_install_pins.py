# SPDX-License-Identifier: Apache-2.0
"""What has no wheel that fits is built from source, for a package of Debian too; pip is stood in for."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Dict

import pytest

pytestmark = pytest.mark.everywhere

ROOT = Path(__file__).resolve().parents[3]
#: pip of a Python for which pybullet has no wheel, with a numpy that is too old for pyastar2d's.
PIP = """#!{python}
import pathlib, re, sys
words = sys.argv[1:]
def option(name):
    return words[words.index(name) + 1] if name in words else ""
asked = "\\n".join([*words, open(option("-r")).read() if "-r" in words else ""])
folder = pathlib.Path(option("--target"))
for name in re.findall("^([a-z0-9_]+)==", asked, re.MULTILINE):
    from_source = option("--no-binary") == name
    if name == "pybullet" and not from_source:
        sys.exit("no wheel of pybullet")
    unfit = name == "pyastar2d" and not from_source
    (folder / (name + ".py")).write_text("raise ImportError" if unfit else "")
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout with its virtual environment, whose lists are short."""
    for name in ("tools", ".venv/bin", "library"):
        (tmp_path / name).mkdir(parents=True)
    for name in ("install_pins.sh", "packages.sh"):
        shutil.copy(str(ROOT / "tools" / name), str(tmp_path / "tools"))
    (tmp_path / "requirements.txt").write_text("# --- all ---\npybullet==3.2.7\npy_trees==1\n")
    (tmp_path / "requirements-nodeps.txt").write_text("# --- navigation ---\npyastar2d==1.0.6\n")
    os.symlink(sys.executable, str(tmp_path / ".venv/bin/python"))
    return tmp_path


def install(checkout: Path, pip: str) -> "subprocess.CompletedProcess[str]":
    file = checkout / ".venv/bin/pip"
    file.write_text(pip.replace("{python}", sys.executable))
    file.chmod(0o755)
    command = [str(checkout / "tools/install_pins.sh"), "simulation", str(checkout / "library")]
    env: Dict[str, str] = {"PATH": os.environ["PATH"], "OPT_ROS": "/nowhere"}
    return subprocess.run(command, env=env, capture_output=True, text=True, check=False)


def test_what_has_no_wheel_that_fits_is_built_from_source(checkout: Path) -> None:
    done = install(checkout, PIP)
    assert done.returncode == 0, done.stderr
    env = {**os.environ, "PYTHONPATH": str(checkout / "library")}
    subprocess.run([sys.executable, "-c", "import py_trees, pyastar2d, pybullet"], env=env, check=True)
    assert "pybullet==3.2.7 has no wheel for this Python" in done.stdout


def test_a_pin_that_cannot_be_had_is_reported(checkout: Path) -> None:
    done = install(checkout, "#!/bin/sh\necho no such version >&2; exit 1\n")
    assert done.returncode == 1
    assert done.stderr.startswith("no such version\nbuild: pip could not build pybullet==3.2.7 (network?)")
