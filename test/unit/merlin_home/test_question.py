"""The question of the missions."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from merlin_home.question import QUESTION

LAUNCH = Path(__file__).resolve().parents[3] / "launch" / "include" / "home_robot.launch"


def test_the_launch_file_has_the_question_synthesised_at_the_start() -> None:
    values = [
        arg.get("value") for arg in ElementTree.parse(LAUNCH).iter("arg") if arg.get("name") == "phrases"
    ]
    assert values == [f"['{QUESTION}']"]
