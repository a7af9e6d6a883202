# SPDX-License-Identifier: Apache-2.0
"""Which runs the experiment is made of."""

from dataclasses import dataclass
from typing import Dict, Iterable, List, Sequence, Tuple

from merlin_home.mission_list import mission_tasks

APPROACHES = ("naive", "merlin")
#: Pairs of runs of each mission, as in the paper.
DEFAULT_RUNS = {1: 5, 2: 5, 3: 1}
#: Of the sensitivity to `cancel_after`, s.
CANCEL_TIMES = (1.0, 2.0, 5.0, 8.0, 10.0, 12.0, 15.0, 20.0)
#: Of the sensitivity to the share of cancelled tasks; Mission 1 has six.
SHARES = (0.0, 1 / 6, 1 / 3, 1 / 2, 2 / 3, 5 / 6, 1.0)
#: Pairs at factor 1 throughout, which check the adaptive factor.
CHECK_PAIRS = {1: 3, 2: 1}
#: Cancel times of two more arms, s: before the Executor has begun, and before it dispatches.
AT_ONCE, WHILE_PLANNING = 0.001, 0.03

#: Task in which navigation is killed, in the arm that does so.
KILLED_IN = 2


@dataclass(frozen=True)
class ExperimentRun:
    """One run.

    :ivar set: what it is for: main, check, cancel_after, share, or an arm's name.
    :ivar mission: 1, 2 or 3.
    :ivar approach: naive or merlin.
    :ivar seed: of the list; the pair has the same.
    :ivar factor: real-time factor.
    :ivar policy: of the factor.
    :ivar cancel_after: s of ROS time.
    :ivar share: of the tasks that are cancelled.
    :ivar killed_in: task in which navigation is killed; 0: none.
    :ivar world: seed of the generated world; 0: the apartment.
    """

    set: str
    mission: int
    approach: str
    seed: int
    factor: float
    policy: str = "adaptive"
    cancel_after: float = 10.0
    share: float = 0.5
    killed_in: int = 0
    world: int = 0

    @property
    def tasks(self) -> int:
        """Number of tasks of its mission."""
        return mission_tasks(self.mission)

    @property
    def name(self) -> str:
        """Unique among all runs; the name of its folder."""
        return (
            f"m{self.mission}_{self.approach}_seed{self.seed}_cancel{self.cancel_after:g}"
            f"_share{round(self.share * self.tasks)}of{self.tasks}_rtf{self.factor:g}_{self.policy}"
            + (f"_killed{self.killed_in}" if self.killed_in else "")
            + (f"_world{self.world}" if self.world else "")
        )

    def words(self) -> List[str]:
        """Arguments of the launch file."""
        values = {
            "mission": self.mission,
            "approach": self.approach,
            "seed": self.seed,
            "rtf": self.factor,
            "rtf_policy": self.policy,
            "cancel_after": self.cancel_after,
            "marked_share": repr(self.share),
        }
        return [f"{name}:={value}" for name, value in values.items()]


def main_runs(
    missions: Iterable[int], approaches: Sequence[str], runs: Dict[int, int], seed: int, factor: float
) -> List[ExperimentRun]:
    """The runs of the paper's Table 1; pairs stand together, so that a part of it has whole pairs.

    :param missions: 1, 2, 3.
    :param approaches: naive, merlin.
    :param runs: pairs of each mission.
    :param seed: of the first pair; the others count on from it.
    :param factor: real-time factor.
    """
    return [
        ExperimentRun("main", mission, approach, seed + index, factor)
        for mission in missions
        for index in range(runs[mission])
        for approach in approaches
    ]


def check_runs(approaches: Sequence[str], seed: int) -> List[ExperimentRun]:
    """The first lists again at factor 1 throughout."""
    return [
        ExperimentRun("check", mission, approach, seed + index, 1.0, "constant")
        for mission, pairs in CHECK_PAIRS.items()
        for index in range(pairs)
        for approach in approaches
    ]


def sweep_runs(approaches: Sequence[str], pairs: int, seed: int, factor: float) -> List[ExperimentRun]:
    """Mission 1 with other cancel times and shares, very early cancels, and a navigation that dies."""
    variants: List[Tuple[str, float, float]] = [("cancel_after", time, 0.5) for time in CANCEL_TIMES]
    variants += [("share", 10.0, share) for share in SHARES]
    variants += [("at_once", AT_ONCE, 0.5), ("while_planning", WHILE_PLANNING, 0.5)]
    runs = [
        ExperimentRun(name, 1, approach, seed + index, factor, cancel_after=time, share=share)
        for name, time, share in variants
        for index in range(pairs)
        for approach in approaches
    ]
    return runs + [
        ExperimentRun("navigation_killed", 1, approach, seed + index, factor, killed_in=KILLED_IN)
        for index in range(pairs)
        for approach in approaches
    ]


def world_runs(approaches: Sequence[str], worlds: int, seed: int, factor: float) -> List[ExperimentRun]:
    """Mission 1 in generated worlds: a pair in each, with the world's seed as the seed of the list.

    :param approaches: naive, merlin.
    :param worlds: how many.
    :param seed: of the first world; the others count on from it.
    :param factor: real-time factor.
    """
    return [
        ExperimentRun("worlds", 1, approach, number, factor, world=number)
        for number in range(seed, seed + worlds)
        for approach in approaches
    ]
