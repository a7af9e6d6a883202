# SPDX-License-Identifier: Apache-2.0
"""What missions are made of (paper, section 3.2.2). These names are the API of applications."""

from merlin_executor.executor_client import DROP, NEVER, RESUME, outcome_name
from merlin_executor.mission.day import Day
from merlin_executor.mission.goal_dispatcher import GoalDispatcher, MissionFailed, MissionSM
from merlin_executor.mission.goal_state import NOTHING, GoalState
from merlin_executor.mission.mission_node import MissionError, MissionNode, results_folder
from merlin_executor.mission.mission_pause import SKIP, WAIT
from merlin_executor.resending import END, RESEND

__all__ = [
    "DROP",
    "END",
    "NEVER",
    "NOTHING",
    "RESEND",
    "RESUME",
    "SKIP",
    "WAIT",
    "Day",
    "GoalDispatcher",
    "GoalState",
    "MissionError",
    "MissionFailed",
    "MissionNode",
    "MissionSM",
    "outcome_name",
    "results_folder",
]
