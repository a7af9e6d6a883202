"""The goals that an application offers to its operators: a list in YAML."""

from pathlib import Path
from typing import Any, Dict, List, NamedTuple

import yaml

from merlin_monitor.text.phrase import goal_phrase, in_english
from merlin_planning.knowledge_text import PDDLSyntaxError, parse_goal

LONGEST = 4000  # characters of a goal
MOST = 200  # goals
_FIELDS = ("name", "goal", "priority")


class GoalListError(ValueError):
    """The list cannot be used; the text names it and says why."""


class OfferedGoal(NamedTuple):
    """A goal in PDDL, what it is called, and its priority."""

    name: str
    goal: str
    priority: int = 0

    @property
    def shown(self) -> Dict[str, Any]:
        """The fields that the page gets."""
        return {"name": self.name, "goal": self.goal, "priority": self.priority}


def read_goals(path: Path) -> List[OfferedGoal]:
    """The goals of a file: a list of texts, or of ``{name, goal, priority}``.

    :raises GoalListError: when it cannot be used.
    """
    try:
        found: Any = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise GoalListError(f"the list of goals {path} cannot be read: {error}") from error
    except yaml.YAMLError as error:
        raise GoalListError(
            f"the list of goals {path} is not YAML: {' '.join(str(error).split())}"
        ) from error
    if not isinstance(found, list) or not found:
        raise GoalListError(f"the list of goals {path} is not a list; write - {{name: …, goal: (…)}}")
    if len(found) > MOST:
        raise GoalListError(f"the list of goals {path} has {len(found)} goals; at most {MOST} are shown")
    goals = [
        _goal(entry, f"the list of goals {path}, entry {number}") for number, entry in enumerate(found, 1)
    ]
    names = [goal.name for goal in goals]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise GoalListError(f"the list of goals {path} has two goals with the name {twice[0]!r}")
    return goals


def _goal(entry: Any, where: str) -> OfferedGoal:
    if isinstance(entry, str):
        entry = {"goal": entry}
    if not isinstance(entry, dict):
        raise GoalListError(f"{where} is {entry!r}; write {{name: …, goal: (…)}}")
    unknown = [str(field) for field in entry if field not in _FIELDS]
    if unknown:
        raise GoalListError(f"{where} has {unknown[0]!r}; there is {', '.join(_FIELDS)}")
    goal, priority = entry.get("goal"), entry.get("priority", 0)
    if not isinstance(goal, str) or not goal.strip() or len(goal) > LONGEST:
        raise GoalListError(f"{where} has no goal; write goal: (checked kitchen)")
    if not isinstance(priority, int) or isinstance(priority, bool) or abs(priority) >= 2**31:
        raise GoalListError(f"{where} has the priority {priority!r}, which is not a whole number")
    try:
        parse_goal(goal)
    except PDDLSyntaxError as error:
        raise GoalListError(f"{where}: {goal}: {error}") from error
    name = entry.get("name") or in_english(goal_phrase(goal))
    if not isinstance(name, str):
        raise GoalListError(f"{where} has the name {name!r}, which is not a text")
    return OfferedGoal(name, " ".join(goal.split()), priority)
