# SPDX-License-Identifier: Apache-2.0
"""Every message, service and action of the underlay has the wire type of the original package."""

from pathlib import Path

import pytest
import roslib.message
import yaml

SUMS = yaml.safe_load((Path(__file__).parent.parent / "data" / "md5sums.yaml").read_text())
CASES = [(package, name, md5) for package, types in SUMS.items() for name, md5 in types.items()]


@pytest.mark.parametrize("package, name, md5", CASES, ids=[f"{p}/{n}" for p, n, _ in CASES])
def test_md5sum(package: str, name: str, md5: str) -> None:
    found = roslib.message.get_message_class(f"{package}/{name}") or roslib.message.get_service_class(
        f"{package}/{name}"
    )
    assert found is not None, f"{package}/{name} is not generated"
    assert found._md5sum == md5
