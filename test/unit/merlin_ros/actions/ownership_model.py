# SPDX-License-Identifier: Apache-2.0
"""A model of the ownership protocol of docs/reliability.md, small enough to try everything that can happen.

A chain of processes: the first wants actions, each one carries out what the one before sent by sending it
on, the last one moves; a guard stands beside the last. Time goes in rounds: events of the adversary, then
each living process reads what was sent to it in the round before, acts, and sends. The books of leases are
the real ones (`merlin_ros.actions.lease.LeaseBook`); processes, messages and the guard's decision are written
from the document.
"""

from typing import Dict, Iterator, List, Optional, Tuple

from ownership_world import (
    DEAD,
    GONE_SILENCE,
    GUARD,
    HUNG,
    LATE,
    SILENCE,
    UNSEEN,
    UP,
    Event,
    Guard,
    Job,
    Process,
    Rules,
    World,
    action_of,
    expected,
    forgotten,
    life_of,
    passed,
    renewed,
    state_of,
)

from merlin_ros.actions.lease import LeaseState


class Round:
    """Computes one round."""

    def __init__(self, rules: Rules, world: World) -> None:
        self.rules = rules
        self.processes = list(world.processes)
        self.guard = world.guard
        self.old = dict(world.wires)
        self.new: Dict[Tuple[str, int], tuple] = {}
        self.unowned = dict(world.unowned)

    # --- the adversary

    def strike(self, event: Event) -> None:
        """Lets something happen before the processes act."""
        what = event[0]
        if what in ("lose", "delay"):
            kind, arrow = event[1], int(event[2])
            messages = self.old.pop((kind, arrow), ())
            if what == "delay":
                self.old[LATE + kind, arrow] = messages
        elif what == "cancel":
            self._mark(0, f"want.{self.processes[0].life}.{event[1]}")
        elif what == "end":
            last = self.processes[-1]
            jobs = tuple(job for job in last.jobs if action_of(job.goal) != event[1])
            self.processes[-1] = last._replace(jobs=jobs)
        elif int(event[1]) == GUARD:
            self._strike_guard(what)
        else:
            self._strike_process(what, int(event[1]))

    def _strike_guard(self, what: str) -> None:
        if what == "hang":
            self.guard = self.guard._replace(state=HUNG)
        elif what == "resume":
            begun = self.guard.begun and not self.rules.guard_asks
            self.guard = self.guard._replace(state=UP, begun=begun)
        elif what == "kill":
            self.guard = Guard(state=DEAD)
            self._drop(GUARD)
        else:
            self.guard = Guard()

    def _strike_process(self, what: str, index: int) -> None:
        process = self.processes[index]
        if what == "hang":
            self.processes[index] = process._replace(state=HUNG)
        elif what == "resume":
            self.processes[index] = process._replace(state=UP)
        elif what == "kill":
            self.processes[index] = Process(state=DEAD, life=process.life)
            self._drop(index)
        else:
            self.processes[index] = Process(life=process.life + 1)

    def _drop(self, index: int) -> None:
        """What is under way to a process that dies is lost."""
        for kind, arrow in list(self.old):
            if self._reader(kind, arrow) == index:
                del self.old[kind, arrow]

    def _reader(self, kind: str, arrow: int) -> int:
        if arrow == GUARD:
            return GUARD
        return arrow if kind.endswith("status") else arrow + 1

    def struck(self) -> World:
        """The world at the same moment, after :meth:`strike`."""
        wires = tuple(sorted(self.old.items()))
        return World(tuple(self.processes), self.guard, wires, tuple(sorted(self.unowned.items())))

    # --- the processes

    def act(self) -> World:
        """All processes act; the world after it."""
        for (kind, arrow), messages in list(self.old.items()):
            if kind.startswith(LATE):
                self.new[kind[len(LATE) :], arrow] = self.old.pop((kind, arrow))
                continue
            reader = self._reader(kind, arrow)
            alive = self.guard.state if reader == GUARD else self.processes[reader].state
            if alive == HUNG:
                self.new[kind, arrow] = messages + self.new.get((kind, arrow), ())
        for index, process in enumerate(self.processes):
            if process.state == UP:
                self._act(index)
        if self.guard.state == UP:
            self._guard()
        self._judge()
        wires = tuple(
            sorted((key, _thin(key[0], messages)) for key, messages in self.new.items() if messages)
        )
        return World(tuple(self.processes), self.guard, wires, tuple(sorted(self.unowned.items())))

    def _send(self, kind: str, arrow: int, message: object) -> None:
        reader = self._reader(kind, arrow)
        state = self.guard.state if reader == GUARD else self.processes[reader].state
        if state != DEAD:
            self.new[kind, arrow] = (*self.new.get((kind, arrow), ()), message)

    def _read(self, kind: str, arrow: int) -> tuple:
        return self.old.pop((kind, arrow), ())

    def _mark(self, index: int, goal: str) -> None:
        """A goal is to be cancelled."""
        process = self.processes[index]
        jobs = tuple(job._replace(cancelled=True) if job.goal == goal else job for job in process.jobs)
        self.processes[index] = process._replace(jobs=jobs)

    def _act(self, index: int) -> None:
        running = {job.goal for job in self.processes[index].jobs}
        if index > 0:
            self._serve(index)
        if index < self.rules.length:
            self._send_on(index)
        if index > 0:
            process = self.processes[index]
            status = tuple(sorted(job.goal for job in process.jobs))
            book = process.book
            for goal in running - set(status):
                book = forgotten(book, goal)
            self.processes[index] = process._replace(book=book)
            self._send("status", index - 1, status)
            if index == self.rules.length:
                self._send("status", GUARD, status)

    def _serve(self, index: int) -> None:
        arrow = index - 1
        process = self.processes[index]
        # The last one stops in the round after it has read a cancel.
        jobs = [job for job in process.jobs if not job.cancelled or index < self.rules.length]
        book = process.book
        heard = process.heard
        leasing = self.rules.server_leases or index < self.rules.length
        for goal in self._read("goal", arrow):
            if any(job.goal == goal for job in jobs):
                continue
            if leasing and state_of(book, goal) is LeaseState.LOST:
                continue
            # Runs already: the one before it has to end first.
            action = action_of(goal)
            jobs = [job._replace(cancelled=True) if action_of(job.goal) == action else job for job in jobs]
            jobs.append(Job(goal))
            if leasing and self.rules.leases_named:
                book = expected(book, str(arrow), goal)
        cancelled = set(self._read("cancel", arrow))
        leases = self._read("lease", arrow)
        if leasing:
            for life, held, suspended in leases:
                heard = max(heard, life)
                book, lost = renewed(book, str(arrow), str(life), held, suspended)
                cancelled.update(lost)
            client = self.processes[arrow]
            connected = (str(arrow),) if client.state != DEAD and client.life == heard else ()
            book, lost = passed(book, connected)
            cancelled.update(lost)
        jobs = [job._replace(cancelled=True) if job.goal in cancelled else job for job in jobs]
        self.processes[index] = process._replace(jobs=tuple(jobs), book=book, heard=heard)

    def _send_on(self, index: int) -> None:
        process = self.processes[index]
        statuses = self._read("status", index)
        listed = set(statuses[-1]) if statuses else set()
        server = self.processes[index + 1]
        silence = 0 if statuses else min(process.silence + 1, SILENCE + 1)
        gone = silence > (GONE_SILENCE if server.state == DEAD else SILENCE)
        given_up = set(process.given_up)
        jobs: List[Job] = []
        for job in process.jobs:
            kept = self._carry_on(index, job, process, statuses, listed, gone, given_up)
            if kept is not None:
                jobs.append(kept)
        if statuses:
            given_up &= listed
        cancels = set(given_up)
        if self.rules.own_earlier_cancelled:
            mine = f"{index}."
            cancels.update(goal for goal in listed if goal.startswith(mine) and life_of(goal) < process.life)
        for goal in sorted(cancels):
            self._send("cancel", index, goal)
        held = tuple(sorted(job.child for job in jobs if job.child))
        suspended = tuple(
            sorted(
                job.child
                for job in jobs
                if job.child and index > 0 and state_of(process.book, job.goal) is LeaseState.SUSPENDED
            )
        )
        before = any(job.child for job in process.jobs)
        if held or before:
            lease = (process.life, held, suspended)
            self._send("lease", index, lease)
            if index == self.rules.length - 1:
                self._send("lease", GUARD, lease)
        self.processes[index] = process._replace(
            jobs=tuple(jobs), silence=silence, given_up=tuple(sorted(given_up))
        )

    def _carry_on(
        self,
        index: int,
        job: Job,
        process: Process,
        statuses: tuple,
        listed: set,
        gone: bool,
        given_up: set,
    ) -> Optional[Job]:
        """The job after this round; None: it has ended."""
        if not job.child:
            if job.cancelled:
                return None
            busy = any(other.child and action_of(other.goal) == action_of(job.goal) for other in process.jobs)
            if busy:
                return job
            child = f"{index}.{process.life}.{action_of(job.goal)}"
            self._send("goal", index, child)
            return job._replace(child=child)
        age = min(job.age + 1, UNSEEN + 1)
        seen = job.seen or job.child in listed
        if statuses and job.child not in listed and (job.seen or age > UNSEEN):
            if not job.seen:
                given_up.add(job.child)
            return None  # it has ended there, or never arrived
        if gone:
            given_up.add(job.child)
            return None
        if job.cancelled and (self.rules.repeat_cancel or not job.asked):
            self._send("cancel", index, job.child)
        return job._replace(seen=seen, age=age, asked=job.cancelled)

    # --- the guard

    def _guard(self) -> None:
        guard = self.guard
        book, heard, earlier = guard.book, guard.heard, set(guard.earlier)
        statuses = self._read("status", GUARD)
        listed, begins = guard.listed, not guard.begun
        if statuses:
            listed = statuses[-1]
            if begins and self.rules.guard_asks:
                earlier = set(listed)
        cancels = set()
        for life, held, suspended in self._read("lease", GUARD):
            heard = max(heard, life)
            book, lost = renewed(book, "client", str(life), held, suspended)
            cancels.update(lost)
            if not begins:  # what waited for a guard that hung may be older than its sender's death
                earlier -= set(held)
        if self.rules.leases_named:
            for goal in listed:
                book = expected(book, "client", goal)
        client = self.processes[self.rules.length - 1]
        connected = ("client",) if client.state != DEAD and client.life == heard else ()
        book, _ = passed(book, connected)
        for goal in listed:
            if state_of(book, goal) is LeaseState.LOST:
                self._send("cancel", self.rules.length - 1, goal)
        asked = tuple(sorted(earlier & set(listed)))
        self.guard = Guard(UP, book, heard, listed, bool(statuses), bool(statuses) or not begins, asked)

    # --- the judge

    def _judge(self) -> None:
        last = self.processes[-1]
        ages = {}
        for job in last.jobs:
            before = self.unowned.get(job.goal, 0)
            if self._owned(job.goal):
                ages[job.goal] = 0
            else:
                ages[job.goal] = min(before + (last.state == UP), 60)
        self.unowned = {goal: age for goal, age in ages.items() if age}

    def _owned(self, goal: str) -> bool:
        for index in range(self.rules.length - 1, -1, -1):
            process = self.processes[index]
            if process.state != UP or process.life != life_of(goal):
                return False
            owner = next((job for job in process.jobs if job.child == goal), None)
            if owner is None or owner.cancelled:
                return False
            goal = owner.goal
        return True


def _thin(kind: str, messages: tuple) -> tuple:
    """Of many leases or lists that wait for a process that hangs the last one of each life counts."""
    if kind == "status":
        return messages[-1:]
    if kind == "lease":
        return tuple(
            lease
            for number, lease in enumerate(messages)
            if number + 1 == len(messages) or messages[number + 1][0] != lease[0]
        )
    return tuple(dict.fromkeys(messages))


def struck(rules: Rules, world: World, event: Event) -> World:
    """The world at the same moment, after an event."""
    turn = Round(rules, world)
    turn.strike(event)
    return turn.struck()


def after(rules: Rules, world: World) -> World:
    """The world one round later."""
    return Round(rules, world).act()


def events(rules: Rules, world: World) -> Iterator[Event]:
    """What may happen now."""
    states = [(index, process.state) for index, process in enumerate(world.processes)]
    for index, state in [*states, (GUARD, world.guard.state)]:
        if state == UP:
            yield "hang", str(index)
            yield "kill", str(index)
        elif state == HUNG:
            yield "resume", str(index)
            yield "kill", str(index)
        else:
            yield "restart", str(index)
    for (kind, arrow), _ in world.wires:
        if not kind.startswith(LATE):
            yield "lose", kind, str(arrow)
            yield "delay", kind, str(arrow)
    for job in world.processes[0].jobs:
        if not job.cancelled:
            yield "cancel", action_of(job.goal)
    for action in sorted({action_of(job.goal) for job in world.processes[-1].jobs}):
        yield "end", action


def healed(rules: Rules, world: World) -> World:
    """The same moment when everything lives again and the first process wants nothing any more."""
    for index, process in enumerate(world.processes):
        if process.state != UP:
            event = ("restart" if process.state == DEAD else "resume", str(index))
            world = struck(rules, world, event)
    if world.guard.state != UP:
        world = struck(rules, world, ("restart" if world.guard.state == DEAD else "resume", str(GUARD)))
    for job in world.processes[0].jobs:
        world = struck(rules, world, ("cancel", action_of(job.goal)))
    return world


def quiet(world: World) -> bool:
    """Whether nothing runs and nothing is on its way but empty lists."""
    under_way = [message for (kind, _), messages in world.wires for message in messages if kind != "lease"]
    return not any(process.jobs or process.given_up for process in world.processes) and not any(under_way)


def wanted(world: World, action: str) -> World:
    """The first process wants one more action."""
    first = world.processes[0]
    job = Job(goal=f"want.{first.life}.{action}")
    return world._replace(processes=(first._replace(jobs=(*first.jobs, job)), *world.processes[1:]))
