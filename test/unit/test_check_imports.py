# SPDX-License-Identifier: Apache-2.0
"""The check of imports finds what the architecture forbids, and nothing else."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

TOOL = Path(__file__).resolve().parents[2] / "tools" / "check_imports.py"


@pytest.fixture
def tool(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location("check_imports", TOOL)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "SRC", tmp_path / "src")
    return module


def write(tmp_path: Path, package: str, module: str, text: str, *depends: str, home: str = "src") -> None:
    root = tmp_path / home / package
    path = root / "src" / package / f"{module}.py"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    (root / "package.xml").write_text("".join(f"<exec_depend>{name}</exec_depend>" for name in depends))


def test_allowed_imports_pass(tool: ModuleType, tmp_path: Path) -> None:
    write(
        tmp_path,
        "merlin_sim",
        "node/pacer",
        "import math\nfrom merlin_sim.world import survey\n",
        "merlin_sm",
    )
    write(tmp_path, "merlin_sim", "world/survey", "import merlin_ros.node\nimport pybullet\n", "merlin_ros")
    write(tmp_path, "merlin_rosplan", "dispatch/rules", "import merlin_ros.alarms\n", "merlin_ros")
    assert tool.main() == 0


@pytest.mark.parametrize(
    ("package", "module", "text", "finding"),
    [
        ("merlin_home", "question", "import merlin_sim.node\n", "merlin_home may import merlin_msgs, "),
        ("merlin_home", "question", "def f():\n    from merlin_sim import node\n", "question.py:2: imports"),
        (
            "merlin",
            "runner",
            "import merlin_sim\n",
            "merlin may import merlin_msgs, merlin_ros, merlin_pddl",
        ),
        (
            "merlin_sim",
            "world/survey",
            "from merlin_sim.node import pacer\n",
            "node is not below merlin_sim/w",
        ),
        ("merlin_sim", "world/survey", "from ..node import pacer\n", "node is not below merlin_sim/world"),
        (
            "merlin_sim",
            "robot/lidar",
            "from merlin_sim.people import x\n",
            "people is not below merlin_sim/r",
        ),
        ("merlin_sim", "cellar/x", "from merlin_sim.world import y\n", "merlin_sim/cellar has no layer yet"),
        (
            "merlin_rosplan",
            "dispatch/x",
            "import merlin_planning.node\n",
            "merlin_rosplan/dispatch runs without",
        ),
        ("merlin_ros", "alarms", "import rospy\n", "merlin_ros/alarms runs without ROS"),
        ("merlin_sm", "node", "import numpy\n", "merlin_sm/package.xml does not name python3-numpy"),
    ],
)
def test_what_is_forbidden_is_named(
    tool: ModuleType,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    package: str,
    module: str,
    text: str,
    finding: str,
) -> None:
    for room in ("world", "people", "node"):
        write(tmp_path, "merlin_sim", f"{room}/__init__", "")
    write(tmp_path, package, module, text, "merlin_planning", "merlin_sm", "merlin_sim", "rospy")
    assert tool.main() == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert finding in line


def test_a_tool_that_imports_what_has_moved_is_named(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    write(tmp_path, "merlin_sim", "world/survey", "")
    (tmp_path / "src" / "merlin_sim" / "setup.py").touch()
    (tmp_path / "bench").mkdir()
    (tmp_path / "bench" / "measure.py").write_text("import os\nfrom merlin_sim.survey import x\n")
    (tmp_path / "bench" / "good.py").write_text("from merlin_sim.world.survey import x\n")
    assert tool.main() == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "bench/measure.py:2: imports merlin_sim.survey, which does not exist"


def test_a_benchmark_that_imports_what_has_moved_is_named(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    room = tmp_path / "bench" / "planning"
    room.mkdir(parents=True)
    (room / "__init__.py").touch()
    (room / "engines.py").write_text("from planning import problems\nfrom planning.figures import x\n")
    assert tool.main() == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "bench/planning/engines.py:2: imports planning.figures, which does not exist"


def test_packages_that_are_built_when_asked_for_are_checked_too(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    write(tmp_path, "merlin_sm", "client", "import merlin_fleet.hub\n", "merlin_fleet")
    write(tmp_path, "merlin_fleet", "core/agent", "from merlin_fleet import hub\n", home="extras")
    write(
        tmp_path,
        "merlin_fleet",
        "hub",
        "import merlin_sim\nimport merlin_planning\n",
        "merlin_planning",
        home="extras",
    )
    assert tool.main() == 1
    found = capsys.readouterr().err.splitlines()
    for text in (
        "src/merlin_sm/src/merlin_sm/client.py:1: imports merlin_fleet.hub; merlin_sm may import",
        "agent.py:1: imports merlin_fleet.hub; merlin_fleet/. is not below merlin_fleet/core",
        "extras/merlin_fleet/src/merlin_fleet/hub.py:1: imports merlin_sim; merlin_fleet may import",
        "merlin_fleet/package.xml does not name merlin_sim",
    ):
        assert any(text in line for line in found), text
    assert len(found) == 4


def test_what_suites_share_is_checked_too(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    write(tmp_path, "merlin_test", "fixture", "import merlin_sim\n", "merlin_sim")
    (tmp_path / "src" / "merlin_test").rename(tmp_path / "test")
    (tmp_path / "src" / "merlin_test").symlink_to(tmp_path / "test")
    assert tool.main() == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "imports merlin_sim; merlin_test may import merlin_msgs, merlin_ros" in line


@pytest.mark.parametrize(
    "folder", ["src/merlin_guests/src/merlin_guests", "bench", "test/unit/merlin_guests"]
)
def test_a_full_folder_is_named(
    tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture, folder: str
) -> None:
    full = tmp_path / folder
    full.mkdir(parents=True)
    for number in range(tool.MOST_MODULES):
        (full / f"module_{number}.py").touch()
    (full / "__init__.py").touch()
    assert tool.main() == 0
    (full / "one_more.py").touch()
    assert tool.main() == 1
    assert f"{folder}: {tool.MOST_MODULES + 1} modules" in capsys.readouterr().err


def test_a_long_file_is_named(tool: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "test").mkdir()
    (tmp_path / "test" / "full.py").write_text("x = 1\n" * tool.MOST_LINES)
    (tmp_path / "test" / "long.py").write_text("x = 1\n" * (tool.MOST_LINES + 1))
    assert tool.main() == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"test/long.py: {tool.MOST_LINES + 1} lines; {tool.MOST_LINES} is the most"
