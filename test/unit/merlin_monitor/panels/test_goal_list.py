# SPDX-License-Identifier: Apache-2.0
"""The goals that an application offers: read at the start, refused with the entry and the reason."""

import re
from pathlib import Path
from typing import Any

import pytest
from served import TOKEN, WEB, Served
from shown_page import Visit, chromium, fill

from merlin_monitor.panels.control import GoalListError, read_goals

pytestmark = pytest.mark.processes

ROOT = Path(__file__).resolve().parents[4]


def write(folder: Path, text: str) -> Path:
    path = folder / "goals.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_list_of_the_home_can_be_used() -> None:
    goals = read_goals(ROOT / "pddl" / "home" / "goals.yaml")
    assert goals[0].name == "Ask in the kitchen" and goals[0].goal == "(checked kitchen)"
    assert goals[-1].priority == -1


def test_the_list_of_the_readme_can_be_used(tmp_path: Path) -> None:
    readme = (WEB.parent / "README.md").read_text()
    (text,) = [block for block in re.findall(r"```yaml\n(.*?)```", readme, re.DOTALL) if "goal: (" in block]
    assert [goal.goal for goal in read_goals(write(tmp_path, text))] == [
        "(checked kitchen)",
        "(robot_at main_door)",
    ]


def test_a_goal_without_a_name_is_called_what_it_says(tmp_path: Path) -> None:
    (goal,) = read_goals(write(tmp_path, "- (robot_at\n   main_door)"))
    assert goal == ("robot at main door", "(robot_at main_door)", 0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not a list"),
        ("{a: b}", "is not a list"),
        ("- [1", "is not YAML"),
        ("- 5", "entry 1 is 5"),
        ("- {name: x}", "entry 1 has no goal"),
        ("- (a)\n- {goal: (checked}", "entry 2: (checked: "),
        ("- {goal: (a), priority: high}", "the priority 'high'"),
        ("- {goal: (a), priority: true}", "the priority True"),
        ("- {goal: (a), prioritty: 1}", "has 'prioritty'; there is name, goal, priority"),
        ("- {goal: (a), name: [x]}", "which is not a text"),
        ("- (a)\n- (a)", "two goals with the name 'a'"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, text: str, words: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises(GoalListError) as error:
        read_goals(path)
    assert words in str(error.value) and str(path) in str(error.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(GoalListError, match="cannot be read"):
        read_goals(tmp_path / "none.yaml")


def said_and_forgotten(visit: Visit, words: str) -> None:
    """Waits for the answer to what was asked last."""
    visit.wait_text("#control-said", words)
    visit.page.evaluate("document.getElementById('control-said').textContent = ''")


def test_goals_of_the_list_and_of_the_map_are_sent_with_a_token_only(served: Served) -> None:
    fill(served)
    goals: Any = [
        {"name": "Ask there", "goal": "(checked bathroom)", "priority": 3},
        {"name": "Ask elsewhere", "goal": "(checked kitchen)", "priority": 0},
    ]
    served.state.tree.set("control", "goals", goals)
    with chromium() as browser:
        visit = Visit(browser, served.url)
        page = visit.page
        assert not page.is_visible("#offered-goals")
        page.locator(".map-point text", has_text="kitchen").click()
        page.locator("#place-list button", has_text="Ask elsewhere").click()
        page.fill("#token", TOKEN)
        page.keyboard.press("Enter")
        said_and_forgotten(visit, "Sent as")
        page.get_by_role("button", name="Ask elsewhere").click()
        said_and_forgotten(visit, "Sent as")
        page.get_by_role("button", name="Goals at bathroom").focus()
        page.keyboard.press("Enter")
        visit.wait_text("#place-title", "Goals at bathroom")
        assert visit.texts("#place-list button") == ["Ask there", "robot at bathroom"]
        page.locator("#place-list button", has_text="Ask there").click()
        visit.wait("() => !document.getElementById('place-goals').open")
        said_and_forgotten(visit, "Sent as")
        page.locator(".map-point text", has_text="dorm room").click()
        assert visit.texts("#place-list button") == ["robot at dorm room", "dorm room checked"]
        page.locator("#place-list button", has_text="robot at").click()
        said_and_forgotten(visit, "Sent as")
        visit.wait("() => !document.getElementById('place-goals').open")
        assert visit.complaints == []
        visit.close()
    sent = [call[1:] for call in served.robot.calls]
    assert sent == [
        ("(checked kitchen)", 0, "Ana"),
        ("(checked kitchen)", 0, "Ana"),
        ("(checked bathroom)", 3, "Ana"),
        ("(robot_at dorm_room)", 0, "Ana"),
    ]


def test_without_operators_the_map_offers_no_goals(read_only: Served) -> None:
    fill(read_only)
    read_only.state.tree.set("meta", "control", False)
    with chromium() as browser:
        visit = Visit(browser, read_only.url)
        visit.wait_text(".map-point text", "kitchen")
        assert visit.page.locator("[role=button].map-point").count() == 0
        visit.page.locator(".map-point text", has_text="kitchen").click()
        assert not visit.page.evaluate("document.getElementById('place-goals').open")
        visit.close()
