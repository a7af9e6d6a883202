# SPDX-License-Identifier: Apache-2.0
"""What the doctor sees of this computer."""

import os
import socket
from pathlib import Path

import pytest

from merlin.doctor.findings import judge_machine
from merlin.doctor.machine import free_space, is_own, look_at_machine, sound_fault
from merlin_pddl.checks import kairos_check


def test_a_folder_that_is_not_yet_there_has_the_space_of_its_disk(tmp_path: Path) -> None:
    assert free_space(tmp_path / "later" / "log") > 0


def test_a_folder_that_takes_no_file_is_told_apart() -> None:
    assert free_space(Path("/proc/nothing")) == -1


def test_a_folder_that_cannot_be_looked_at_cannot_be_written() -> None:
    assert free_space(Path("/tmp") / ("x" * 300) / "log") == -1


@pytest.mark.parametrize(
    ("name", "own"),
    [("127.0.0.1", True), ("192.0.2.7", False), ("no-such-host.invalid", False)],  # 192.0.2.0/24 is nobody's
)
def test_own_addresses_are_known(name: str, own: bool) -> None:
    assert is_own(name) is own


def test_the_address_and_the_master_that_the_user_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_HOSTNAME", raising=False)
    monkeypatch.setenv("ROS_IP", "192.0.2.7")
    monkeypatch.setenv("ROS_MASTER_URI", "http://192.0.2.8:11311")
    machine = look_at_machine()
    assert machine.address == "ROS_IP=192.0.2.7" and not machine.address_is_own
    assert machine.master_is_elsewhere and machine.host == socket.gethostname()
    assert not machine.missing


def test_a_package_path_without_merlin_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_PACKAGE_PATH", "/opt/ros/noetic/share")
    found = [each.text for each in judge_machine(look_at_machine())]
    assert any("does not find the package merlin" in text for text in found)


def test_what_stands_in_for_kairos_is_a_planner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kairos_check, "available", lambda: False)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert not look_at_machine().planner
    (tmp_path / "popf").touch(mode=0o755)
    assert look_at_machine().planner


@pytest.mark.parametrize("master", ["nonsense", "http://", "http://localhost:port"])
def test_an_address_of_a_master_that_is_none_is_no_traceback(
    master: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", master)
    assert look_at_machine().master == ""


def test_sound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    devices, programs = tmp_path / "snd", tmp_path / "bin"
    devices.mkdir()
    programs.mkdir()
    monkeypatch.setenv("PATH", str(programs))
    assert "no espeak-ng and no aplay" in sound_fault(devices)
    for name in ("espeak-ng", "aplay"):
        (programs / name).touch(mode=0o755)
    assert "no sound device" in sound_fault(devices)
    (devices / "pcmC0D0p").touch()
    assert sound_fault(devices) == ""
    may = os.access  # root may write to anything
    monkeypatch.setattr(os, "access", lambda path, mode: "pcm" not in str(path) and may(path, mode))
    assert "group audio" in sound_fault(devices)
