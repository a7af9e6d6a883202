# SPDX-License-Identifier: Apache-2.0
"""A planning problem: what exists, what holds at the start, what is wanted."""

from dataclasses import dataclass, field
from typing import Dict, List, Optional, Tuple

from merlin_pddl.formula import Condition
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, Metric, Timed


@dataclass
class Problem:
    """A problem as its file, or a knowledge base, states it.

    `timed` holds nanoseconds after the start; `goals` is a conjunction; `instance_goals` want an object to
    exist, which PDDL cannot say; `constraints` are trajectory constraints as PDDL text.
    """

    name: str
    domain_name: str
    objects: Dict[str, Tuple[str, ...]] = field(default_factory=dict)
    facts: List[Fact] = field(default_factory=list)
    values: List[FunctionValue] = field(default_factory=list)
    timed: List[Timed] = field(default_factory=list)
    goals: List[Condition] = field(default_factory=list)
    instance_goals: List[Instance] = field(default_factory=list)
    metric: Optional[Metric] = None
    constraints: List[str] = field(default_factory=list)
