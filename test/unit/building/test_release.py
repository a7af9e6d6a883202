# SPDX-License-Identifier: Apache-2.0
"""What catkin_prepare_release and bloom refuse, read as they read a clone, not a workspace."""

import shutil
import subprocess
from pathlib import Path
from typing import Dict

import pytest
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import Package
from catkin_pkg.package_version import get_forthcoming_label
from catkin_pkg.packages import find_packages, verify_equal_package_versions

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The manifests, the change logs and the links that git has."""
    copy = tmp_path_factory.mktemp("clone")
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=str(ROOT), capture_output=True, text=True, check=True
    )
    for name in listed.stdout.split("\0"):
        file = ROOT / name
        if file.is_symlink() or file.name in ("package.xml", "CHANGELOG.rst"):
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(str(file), str(copy / name), follow_symlinks=False)
    return copy


@pytest.fixture(scope="module")
def packages(clone: Path) -> Dict[str, Package]:
    found: Dict[str, Package] = find_packages(str(clone), warnings=[])
    return found


def test_each_package_is_there_once_and_of_the_version_of_all(packages: Dict[str, Package]) -> None:
    assert {"merlin", "merlin_test", "merlin_fleet", "smach"} <= {
        package.name for package in packages.values()
    }
    assert verify_equal_package_versions(packages.values())


def test_each_manifest_is_right_and_names_the_same_maintainer(
    clone: Path, packages: Dict[str, Package]
) -> None:
    for path, package in packages.items():
        warnings: list = []
        package.validate(warnings=warnings)
        assert not warnings, path
        assert [(person.name, person.email) for person in package.maintainers] == [
            ("The MERLIN developers", "noreply@merlin.invalid")
        ]


def test_each_package_has_a_change_log_of_what_comes(clone: Path, packages: Dict[str, Package]) -> None:
    for path, package in packages.items():
        log = get_changelog_from_path(str(clone / path / "CHANGELOG.rst"), package.name)
        assert log and (get_forthcoming_label(log.rst) or log.get_content_of_version(package.version)), path
