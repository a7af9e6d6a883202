# SPDX-License-Identifier: Apache-2.0
"""What a robot's computer gets instead of a checkout, a Debian package or a container, runs a mission."""

import json
import os
import shutil
import subprocess
import uuid
from pathlib import Path
from typing import Iterator

import pytest

ROOT = Path(__file__).resolve().parents[3]
BUILDING = 7200.0  # s for apt, build and compression, on a machine that does much else
pytestmark = [pytest.mark.long, pytest.mark.timeout(3 * BUILDING)]
DEBIAN = next(
    (
        line.partition("=")[2].strip().strip('"')
        for line in Path("/etc/os-release").read_text().splitlines()
        if line.startswith("VERSION_ID=")
    ),
    "",
)


def missing(*tools: str) -> str:
    """Why a test cannot run here; empty: it can."""
    lacking = [tool for tool in tools if shutil.which(tool) is None]
    if lacking:
        return f"needs {', '.join(lacking)}"
    if os.getuid() != 0:
        return "needs root"
    return "" if DEBIAN in ("12", "13") else "needs Debian 12 or 13"


def run(*command: str, **variables: str) -> str:
    """Runs a command in the checkout, to its end without an error; returns all that it prints."""
    env = {**os.environ, **variables}
    for name in ("CMAKE_PREFIX_PATH", "PYTHONPATH", "ROS_PACKAGE_PATH", "VIRTUAL_ENV"):
        env.pop(name, None)
    done = subprocess.run(
        command,
        cwd=str(ROOT),
        env=env,
        text=True,
        capture_output=True,
        timeout=BUILDING,
    )
    said = done.stdout + done.stderr
    assert done.returncode == 0, f"{' '.join(command)}:\n{said[-4000:]}"
    return said


def judge(said: str, profile: str) -> None:
    """tools/try_installed.sh has said that goals hold, and that the page of the simulation answers."""
    assert "goal (checked bathroom): done" in said
    assert ("the page answers" in said) == (profile == "simulation")


#: What the final layer of the container does without.
COMPILERS = ["cc", "c++", "gcc", "g++", "gcc-12", "g++-12", "cpp", "as", "ld", "make", "cmake", "clang"]
PROFILES = pytest.mark.parametrize("profile", ["robot", "simulation"])


@PROFILES
@pytest.mark.skipif(
    bool(missing("debootstrap", "dpkg-deb", "unshare")), reason=missing("debootstrap", "dpkg-deb", "unshare")
)
def test_the_package_runs_a_mission_and_leaves_nothing(profile: str) -> None:
    run("make", "-s", "deb", f"PROFILE={profile}")
    (package,) = (ROOT / "results" / "deb").glob(f"merlin-{profile}_*.deb")
    said = run("tools/debian.sh", VERSION=DEBIAN, DEB=str(package))
    judge(said, profile)
    assert f"merlin-{profile} is removed" in said


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """An image of Debian 12 that comes from no registry, with the certificates of this machine."""
    root, name = tmp_path_factory.mktemp("base") / "root", f"localhost/merlin-test-{uuid.uuid4().hex}"
    run("debootstrap", "--variant=minbase", "--include=ca-certificates", "bookworm", str(root))
    for certificate in Path("/usr/local/share/ca-certificates").glob("**/*.crt"):
        shutil.copy(str(certificate), str(root / "usr/local/share/ca-certificates"))
    run("chroot", str(root), "update-ca-certificates")
    container = run("buildah", "from", "scratch").split()[0]
    run("buildah", "add", "--quiet", container, str(root), "/")
    run("buildah", "commit", "--quiet", "--rm", container, f"{name}-base")
    shutil.rmtree(str(root))
    yield name
    for image in (name, f"{name}-base"):
        subprocess.run(
            ["buildah", "rmi", "--force", image], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )


@pytest.mark.skipif(bool(missing("debootstrap", "buildah")), reason=missing("debootstrap", "buildah"))
@PROFILES
def test_the_container_runs_a_mission_as_an_ordinary_user(base: str, profile: str) -> None:
    chroot = ["--isolation", "chroot"]
    run(
        "buildah",
        "bud",
        *chroot,
        "--network",
        "host",
        "--build-arg",
        f"BASE={base}-base",
        "--target",
        profile,
        "-t",
        base,
        ".",
    )
    image, _ = json.JSONDecoder().raw_decode(run("buildah", "inspect", "--type", "image", base))
    settings = image["OCIv1"]["config"]
    container = run("buildah", "from", base).split()[0]
    try:
        command = ["buildah", "run", *chroot, "--hostname", "localhost", container, "--"]
        assert run(*command, "id", "-u").split()[0] == "1000"
        tools = run(*command, "sh", "-c", 'for tool; do command -v "$tool"; done; true', "sh", *COMPILERS)
        assert not tools.split(), "build tools in the final layer"
        assert "nothing is wrong" in run(*command, *settings["Entrypoint"], *settings["Cmd"])
        run("buildah", "copy", container, str(ROOT / "tools/try_installed.sh"), "/opt/try_installed.sh")
        judge(run(*command, "/opt/try_installed.sh"), profile)
    finally:
        run("buildah", "rm", container)
