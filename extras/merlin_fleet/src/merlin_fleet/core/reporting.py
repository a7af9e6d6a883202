# SPDX-License-Identifier: Apache-2.0
"""Results on their way to the store: kept until it has them, applied only when the goal is still owned."""

from typing import TYPE_CHECKING, Dict, List, Optional, Tuple

from merlin_fleet.core import records
from merlin_fleet.core.records import RecordError, Report
from merlin_fleet.core.store import Compare, Item, Put, Txn, TxnResult

if TYPE_CHECKING:
    from merlin_fleet.core.agent import Agent

Kept = Tuple[Report, bool]


class Outbox:
    """Keeps reports until the store has them; this one in memory."""

    def __init__(self) -> None:
        self._reports: Dict[Tuple[str, int], Kept] = {}

    def add(self, report: Report, final: bool) -> str:
        """Keeps a report; returns why it will not survive the process, empty: it will."""
        self._reports[(report.goal, report.epoch)] = (report, final)
        return ""

    def remove(self, goal: str, epoch: int) -> None:
        """The store has it."""
        self._reports.pop((goal, epoch), None)

    def reports(self) -> List[Kept]:
        """All that are kept, the oldest first."""
        return list(self._reports.values())


class Reporting:
    """Sends what the outbox keeps."""

    def __init__(self, agent: "Agent", outbox: Outbox) -> None:
        self._agent = agent
        self._outbox = outbox
        self._waiting: Dict[str, Kept] = {}
        for report, final in outbox.reports():
            self._waiting[_name(report.goal, report.epoch)] = (report, final)
        self._late: Dict[str, bool] = {}

    @property
    def waiting(self) -> List[Report]:
        """What the store does not have yet."""
        return [report for report, _ in self._waiting.values()]

    def knows(self, goal: str, epoch: int) -> bool:
        """Whether the end of a goal is on its way."""
        return _name(goal, epoch) in self._waiting

    def add(self, report: Report, final: bool) -> None:
        """A goal has ended.

        :param final: False when another robot may try it.
        """
        self._waiting[_name(report.goal, report.epoch)] = (report, final)
        problem = self._outbox.add(report, final)
        if problem:
            self._agent.say(f"the end of {report.goal} is only in memory: {problem}")

    def decide(self) -> None:
        """Sends what waits. It needs no lease: the store compares the epoch."""
        if not self._agent.usable:
            return
        for name, (report, final) in list(self._waiting.items()):
            if not report.epoch:  # of a store that was replaced; a compare with 0 holds where no claim is
                self._put_aside(name, report)
            if name in self._late:
                self._agent.transact(f"late {name}", self._late_txn(name, report))
            else:
                self._agent.transact(f"report {name}", self._txn(report, final))

    def _txn(self, report: Report, final: bool) -> Txn:
        keys = self._agent.keys
        claim, end = (keys.key(kind, report.robot, report.goal) for kind in (records.CLAIMS, records.ENDS))
        tried = keys.key(records.FAILURES, report.robot, report.goal, str(report.epoch))
        put = Put(end if final else tried, records.encode(report))
        return Txn((Compare(claim, report.epoch),), (put,), (claim,), (end, tried))

    def _late_txn(self, name: str, report: Report) -> Txn:
        key = self._agent.keys.key(records.LATE, report.robot, name)
        return Txn(puts=(Put(key, records.encode(report)),))

    def answered(self, tag: str, result: Optional[TxnResult]) -> None:
        """A transaction has ended."""
        name = tag.split(" ")[1]
        if result is None or name not in self._waiting:
            return
        report, _ = self._waiting[name]
        if result.done or any(_same(item, report) for item in result.items):
            del self._waiting[name]
            self._late.pop(name, None)
            self._outbox.remove(report.goal, report.epoch)
        else:
            self._put_aside(name, report)

    def _put_aside(self, name: str, report: Report) -> None:
        self._late[name] = True
        known = report.goal in self._agent.view.goals
        self._agent.say(
            f"the end of {report.goal} ({report.outcome}) comes after "
            f"{'its lease was lost' if known else 'the fleet has removed that goal'}: "
            "it is recorded as late and not applied"
        )


def _name(goal: str, epoch: int) -> str:
    return f"{goal}.{epoch}"


def _same(item: Item, report: Report) -> bool:
    """Whether the store has this very report: the answer to it was lost."""
    try:
        known: Report = records.decode(Report, item.value)
    except RecordError:
        return False
    return (known.robot, known.epoch) == (report.robot, report.epoch)
