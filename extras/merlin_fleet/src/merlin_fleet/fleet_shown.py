# SPDX-License-Identifier: Apache-2.0
"""What a page shows of a fleet: that of a robot, and that of the fleet."""

import re
from typing import Any, Dict, List, Optional

from merlin_fleet.core.records import Halt, Status
from merlin_fleet.core.view import FleetGoalState
from merlin_fleet.fleet_client import FleetClient
from merlin_fleet.fleet_request import GoalNews
from merlin_monitor.text.phrase import Phrase, say
from merlin_monitor.text.request_words import STAGES
from merlin_monitor.text.wording import Wording

WORDING = Wording()  # the sentences are those of the robots, which do not send them
MOST = 40  # goals that are shown: those that continue first, then the last ones that have ended


def shown(client: FleetClient, most: int = MOST) -> Dict[str, Any]:
    """What a page shows of a fleet.

    :param most: goals that are listed.
    """
    missing, heard = client.missing, client.heard
    goals = client.goals(most)
    going = [news for news in goals if news.report is None]
    over = sorted((news for news in goals if news.report is not None), key=_ended, reverse=True)
    owned: Dict[str, List[str]] = {}
    for news in going:
        if news.owner:
            owned.setdefault(news.owner, []).append(" ".join(news.goal.goals))
    robots = {
        robot.name: {
            "joined": joined,
            "heard": client.status(robot.name)[0].at or robot.heard,
            "spoke": client.spoke(robot.name),  # its clock may be wrong: what is shown is as old as that
            "is": [*robot.groups, *robot.capabilities],
            "has": owned.get(robot.name, []),
            **_said(*client.status(robot.name)),
        }
        for robot, joined in client.robots()
    }
    listed = [*going, *over][:most]
    silent = {"node": "etcd", "what": "is not reached", "since": heard}
    return {
        "fleet": client.fleet,
        "robots": robots,
        "goals": [_goal(news) for news in listed],
        "more": len(goals) - len(listed),
        "counts": {
            "joined": sum(joined for _, joined in client.robots()),
            "robots": len(robots),
            "owned": sum(bool(news.owner) for news in going),
            "open": sum(not news.owner for news in going),
        },
        "missing": missing,
        "missing_since": (heard or None) if missing else None,
        # Grey: the page shows the state at the last contact with the hub.
        "silent": silent if missing and heard else None,
    }


def _goal(news: GoalNews) -> Dict[str, Any]:
    report = news.report
    state = news.state.value if report is None else report.outcome.lower().replace("_", " ")
    refusals = [f"{robot}: {reason}" for robot, reason in sorted(news.refusals.items())]
    open_because = [news.hopeless, *refusals] if news.hopeless else refusals
    return {
        "id": news.goal.id,
        "text": " ".join(news.goal.goals),
        "sender": news.goal.sender,
        "state": state,
        "over": report is not None,
        "robot": report.robot if report is not None else news.owner,
        "finish": news.goal.finish and news.state in (FleetGoalState.OWNED, FleetGoalState.CANCELLING),
        "why": report.reason if report is not None else "; ".join(open_because),
    }


def _ended(news: GoalNews) -> float:
    return news.report.at if news.report is not None else 0.0


def _said(status: Status, halt: Optional[Halt]) -> Dict[str, Any]:
    """What a robot says of itself. The text of a record may be anything: a link leads to a page only."""
    doing = [_action(text) for text in status.doing]
    stage = [say(STAGES.get(status.stage, "working"))] if status.stage else [say("waits")]
    known = status.x is not None and status.y is not None
    return {
        "does": status.trouble or (doing or stage if status.at else ""),
        "for": [WORDING.goal(goal) for goal in status.goals],
        "place": status.place.replace("_", " "),
        "at": [round(status.x or 0.0, 1), round(status.y or 0.0, 1)] if known else None,
        "hold": status.hold,
        "stop": halt.at if halt is not None else None,
        "page": status.page if re.match(r"https?://[^/@]+(/|\Z)", status.page) else "",
    }


def _action(text: str) -> Phrase:
    name, *pairs = text.split() or [""]
    return WORDING.action(name, [(key, value) for key, _, value in (pair.partition("=") for pair in pairs)])
