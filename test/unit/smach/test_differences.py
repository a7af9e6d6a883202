# SPDX-License-Identifier: Apache-2.0
"""Each difference from SMACH in the tables of the READMEs has a test that is named after it."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
TESTS = "".join(
    path.read_text()
    for folder in ("test/unit/smach", "test/unit/smach_ros", "test/rostest/smach")
    for path in sorted((ROOT / folder).glob("*.py"))
)


@pytest.mark.parametrize("package", ["smach", "smach_ros"])
def test_every_numbered_difference_has_a_test(package):
    table = (ROOT / f"src/underlay/{package}/README.md").read_text().partition("## What differs")[2]
    rows = re.findall(r"^\| ([A-Z]\d+(?:, [A-Z]\d+)*) \|", table, re.MULTILINE)
    numbers = {number for row in rows for number in row.split(", ")}
    assert len(numbers) > 20
    lacking = [
        number
        for number in sorted(numbers)
        if not re.search(rf"def test_(\w+_)?{number.lower()}_|\b{number}\b", TESTS)
    ]
    assert lacking == []
