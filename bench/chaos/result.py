# SPDX-License-Identifier: Apache-2.0
"""A trial that was carried out, with what it showed."""

from dataclasses import dataclass, field
from typing import List, Optional

from chaos.judging import events
from chaos.judging.events import Event
from chaos.judging.rules import Judgement
from chaos.trials import Trial

_ONE = Event(0.0, events.WAITED, {"span": 1.0, "waited": 0.0})


@dataclass
class Result:
    """A trial that was carried out.

    :param trial: what was done.
    :param judgement: what it showed; None when it is not valid.
    :param note: what else is to be said.
    :param log: the events.
    :param helped: what the campaign repaired.
    :param load: load average of the machine.
    :param struck: whether its fault was done.
    """

    trial: Trial
    judgement: Optional[Judgement]
    note: str = ""
    log: List[Event] = field(default_factory=list)
    helped: str = ""
    load: float = 0.0
    struck: bool = True

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second of the trial: below 1 the machine was too busy for its figures."""
        truth = [event for event in self.log if event.kind == events.TRUTH]
        if len(truth) < 2 or truth[-1].at <= truth[0].at:
            return 0.0
        return float(truth[-1]["ros"] - truth[0]["ros"]) / (truth[-1].at - truth[0].at)

    @property
    def waited(self) -> float:
        """Share of the trial in which the system had to wait for a processor, at most."""
        samples = [event for event in self.log if event.kind == events.WAITED]
        return sum(event["waited"] for event in samples) / sum(event["span"] for event in samples or [_ONE])

    @property
    def clean(self) -> bool:
        """Whether the system can be trusted with the next trial."""
        return self.judgement is not None and not self.judgement.violations
