# SPDX-License-Identifier: Apache-2.0
"""The folder of a lab's certificates: what is made, what is never made again, and which names are refused."""

from pathlib import Path
from typing import List

import pytest

from merlin_fleet.certificates import CertificateError, Folder, make_certificates


def test_what_is_there_is_never_made_again(tmp_path: Path) -> None:
    first = make_certificates(tmp_path, ["hub.lab", "10.1.2.3", "::1"], ["ann"], ["desk"])
    assert first == ["ca", "root", "hub", "robot.ann", "client.desk"]
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert make_certificates(tmp_path, [], ["ann", "bob"], []) == ["robot.bob"]
    assert {path: path.read_bytes() for path in before} == before
    assert all(path.stat().st_mode & 0o077 == 0 for path in tmp_path.glob("*.key"))


def test_a_further_host_needs_another_certificate(tmp_path: Path) -> None:
    make_certificates(tmp_path, ["hub.lab", "10.1.2.3", "::1"], [], [])
    assert make_certificates(tmp_path, ["::1", "hub.lab"], ["ann"], []) == ["robot.ann"]
    with pytest.raises(CertificateError, match=r"hub\.pem is not for hub2\.lab; .*remove hub\.pem"):
        make_certificates(tmp_path, ["hub.lab", "hub2.lab"], ["bob"], [])
    for end in ("pem", "key"):
        (tmp_path / f"hub.{end}").unlink()
    assert make_certificates(tmp_path, ["hub.lab", "hub2.lab"], ["bob"], []) == ["hub", "robot.bob"]


def test_a_removed_name_is_not_given_again(tmp_path: Path) -> None:
    make_certificates(tmp_path, ["hub"], ["ann"], [])
    Folder(tmp_path).note_removal("robot.ann")
    assert make_certificates(tmp_path, [], ["ann", "bob"], []) == ["robot.bob"]
    assert Folder(tmp_path).names("robot") == ["bob"]
    for end in ("pem", "key"):
        (tmp_path / f"robot.ann.{end}").unlink()
    with pytest.raises(CertificateError, match="robot.ann was removed"):
        make_certificates(tmp_path, [], ["ann"], [])
    for name in ("root", "robot.", "robot.a/../b", "ann"):
        with pytest.raises(CertificateError):
            Folder(tmp_path).note_removal(name)


@pytest.mark.parametrize(
    ("hosts", "robots", "message"),
    [
        ([], ["ann"], "name the hub's host"),
        (["a,DNS:b"], [], "not the name or the address of a host"),
        (["hub"], ["../ann"], "is not a word"),
        (["hub"], ["a" * 60], "too long for a certificate"),
    ],
)
def test_names_that_cannot_be(tmp_path: Path, hosts: List[str], robots: List[str], message: str) -> None:
    with pytest.raises(CertificateError, match=message):
        make_certificates(tmp_path / "new", hosts, robots, [])


def test_the_path_of_a_certificate_may_begin_at_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_certificates(tmp_path / "keys", ["hub"], ["ann"], [])
    monkeypatch.setenv("HOME", str(tmp_path))
    assert Folder(Path("~/keys")).tls("robot.ann").credentials()  # as in an argument of roslaunch
