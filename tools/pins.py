# SPDX-License-Identifier: Apache-2.0
"""Asks pip's resolver whether the pins of a profile can be had as wheels, for each Python and processor.

Nothing is installed. The table goes to the screen, or into docs/platforms.md. Ends with 1 when that page has
another one for the profile robot, and with 2 when the package index does not answer.

Usage: pins.py [--profile robot] [--docs]
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Dict, List, NamedTuple, Sequence

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "platforms.md"
BEGIN, END = "<!-- table of make pins: begin -->\n", "<!-- table of make pins: end -->\n"
ROBOT = "robot"
LISTS = ("requirements.txt", "requirements-nodeps.txt")
PROCESSORS = ("x86_64", "aarch64")
#: A package that each index has, for each Python: an index that lacks it does not answer.
ALWAYS = "packaging"
LONGEST = 300.0  # s for one question


class Platform(NamedTuple):
    """A Python, the system that has it, and the minor version of its glibc 2."""

    python: str
    system: str
    glibc: int


PLATFORMS = (
    Platform("3.8", "Ubuntu 20.04", 31),
    Platform("3.9", "Debian 11", 31),
    Platform("3.10", "Ubuntu 22.04", 35),
    Platform("3.11", "Debian 12", 36),
    Platform("3.12", "Ubuntu 24.04", 39),
    Platform("3.13", "Debian 13", 41),
)


class IndexSilent(Exception):
    """The package index does not answer; the text is a sentence."""


def wanted(lines: Sequence[str], python: str, processor: str) -> List[str]:
    """The pins that hold there, without their markers, which pip reads for its own Python."""
    there: Dict[str, str] = {
        "python_version": python,
        "python_full_version": f"{python}.0",
        "sys_platform": "linux",
        "platform_machine": processor,
    }
    pins = [Requirement(line) for line in lines if line.strip() and not line.startswith("#")]
    return [
        f"{pin.name}{pin.specifier}" for pin in pins if pin.marker is None or pin.marker.evaluate(dict(there))
    ]


def left_out(lines: Sequence[str], python: str, processor: str) -> List[str]:
    """The packages of which no pin holds there."""
    held = {pin.split("==")[0] for pin in wanted(lines, python, processor)}
    names = [Requirement(line).name for line in lines if line.strip() and not line.startswith("#")]
    return [name for name in dict.fromkeys(names) if name not in held]


def missing(platform: Platform, processor: str, profile: str) -> List[str]:
    """The pins that cannot be had there.

    :raises IndexSilent: when the index does not answer.
    """
    found = []
    for name in LISTS:
        text = _run(["tools/packages.sh", name, profile]).stdout
        pins = wanted(text.splitlines(), platform.python, processor)
        options = ["--no-deps"] if name != LISTS[0] else []
        if pins and not _resolves(pins, platform, processor, options):
            alone = [pin for pin in pins if not _resolves([pin], platform, processor, options)]
            found += alone or [f"{' and '.join(pins)} together"]
    if found and not _resolves([ALWAYS], platform, processor, ["--no-deps"]):
        raise IndexSilent(f"pip finds not even {ALWAYS}: the package index does not answer")
    return found


def _resolves(pins: List[str], platform: Platform, processor: str, options: List[str]) -> bool:
    # pip does not conclude from a newer glibc that wheels for older ones fit.
    tags = [f"manylinux_2_{minor}_{processor}" for minor in range(platform.glibc, 4, -1)]
    tags += [f"manylinux{name}_{processor}" for name in ("2014", "2010", "1")] + [f"linux_{processor}"]
    with tempfile.TemporaryDirectory() as folder:
        return not _run(
            [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-q", "--dry-run"]
            + ["--ignore-installed", "--only-binary=:all:", "--implementation", "cp", "--target", folder]
            + ["--python-version", platform.python, *(f"--platform={tag}" for tag in tags), *options, *pins]
        ).returncode


def _run(command: List[str]) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(
            command, cwd=str(ROOT), capture_output=True, text=True, check=False, timeout=LONGEST
        )
    except subprocess.TimeoutExpired as error:
        raise IndexSilent(f"pip had no answer within {LONGEST:g} s; is there a network?") from error


def main() -> int:
    """Prints or writes the table; returns the exit code."""
    parser = argparse.ArgumentParser(prog="pins", description="which pins can be had as wheels, and where")
    parser.add_argument("--profile", default=ROBOT, choices=[ROBOT, "simulation", "all"])
    parser.add_argument("--docs", action="store_true", help="write the table of robot into docs/platforms.md")
    asked = parser.parse_args()
    rows = [f"| Python | as in | {' | '.join(PROCESSORS)} |", "|---|---|" + "---|" * len(PROCESSORS)]
    lines = "".join(_run(["tools/packages.sh", name, asked.profile]).stdout for name in LISTS).splitlines()
    try:
        for platform in PLATFORMS:
            cells = []
            for processor in PROCESSORS:
                gone = missing(platform, processor, asked.profile)
                left = left_out(lines, platform.python, processor)
                cells.append(f"no wheel of {', '.join(gone)}" if gone else "all")
                cells[-1] += f"; left out: {', '.join(left)}" if left else ""
            rows.append(f"| {platform.python} | {platform.system} | {' | '.join(cells)} |")
            print(f"pins: {rows[-1]}", file=sys.stderr)
    except IndexSilent as error:
        print(f"pins: {error}", file=sys.stderr)
        return 2
    table = "\n".join(rows) + "\n"
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    known, after = rest.split(END)
    if asked.docs and asked.profile == ROBOT:
        PAGE.write_text(f"{before}{BEGIN}{table}{END}{after}", encoding="utf-8")
        return 0
    print(table, end="")
    if asked.profile == ROBOT and table != known:
        print("pins: docs/platforms.md has another table; write this one: make pins DOCS=1", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
