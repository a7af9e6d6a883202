# SPDX-License-Identifier: Apache-2.0
"""Carries one trial out on a running system and judges it."""

import os
import random
import threading
import time
from typing import Callable, Dict, List, Optional, Set, Tuple

from chaos.before import BrokenBefore, Missed, ended_before, failed_before
from chaos.faults import CLIENT, DISK_FULL, MASTER, NONE, SECOND_NODE
from chaos.injector import SIGNALS, Injector
from chaos.judging import events
from chaos.judging.events import Event, LogClosed
from chaos.judging.evidence import JOINED, NEXT, PATIENCE, REQUEST, Evidence, settled
from chaos.judging.knowledge_rules import FACTS_LIMIT
from chaos.judging.rules import ANSWER_LIMIT, NEXT_LIMIT_HELPED, STAND_LIMIT_HUNG, Judgement, judge
from chaos.judging.scene import DRIVING_SPEED, Scene, scene_at
from chaos.judging.why_rules import asked_about
from chaos.moments import WINDOWS, Moment, begins, holds
from chaos.result import Result
from chaos.striking.stroke import NotRunning
from chaos.striking.surroundings import WRITTEN_FACTS
from chaos.trials import DRIVE, LISTEN, REQUESTS, SPEAK, Trial
from chaos.under_test import processes
from chaos.under_test.system import StartError, System
from chaos.watching import Watching

#: s for a moment to come; the longest way to one is a plan and a turn on the spot.
MOMENT_LIMIT = 40.0
#: s that an answer is waited for: twice what it may take, so that it is measured.
ANSWER_WATCH = 20.0
#: s after which a request that was not cancelled is cancelled.
UNTOLD_WATCH = 10.5
#: The same where it is to fail by itself, and is asked why: all plans are tried first.
FAILING_WATCH = 90.0
#: s after a fault, or after its end, from when a request that drives is known to continue.
GOES_ON = 4.0
#: The same without a master, which is missed later.
GOES_ON_MASTER = 7.0
#: s that the next goal is waited for beyond what a starved machine may make of its limit.
NEXT_MARGIN = 1.0
#: s watched after an end, for what must no longer move.
SETTLE = 1.5
LOOK_WATCH = 12.0
#: s for an answer to why a request failed: longer than it may take.
WHY_WATCH = 30.0
#: s after a trial in which every node is back; the script that starts it again waits 4 s at most.
NODES_LIMIT = 10.0
#: s between two looks at knowledge that is not settled.
LOOK_PERIOD = 0.3
#: s after which the watchdog ends a trial with everything that it runs.
TRIAL_LIMIT = 180.0
#: Last word of the command line of what the campaign's planner leaves behind.
PLANNER_CHILD = "planner_child"
#: m that a place to drive to is away at least.
FAR = 2.0
#: What requests say that join another one, and by when one of them has to be done, s.
JOINED_NOTES, DEADLINES = ("f1", "f2"), (8.0, 60.0)
#: Predicates of the other ways to drive to a place.
DRIVES = ("deaf_at", "touchy_at", "plain_at")


class Runner:
    """Runs trials on one system.

    :param points: x, y of the points of interest.
    :param patience: see :class:`.evidence.Evidence`.
    :param why: ask the robot why a request failed.
    """

    def __init__(
        self,
        system: System,
        points: Dict[str, Tuple[float, float]],
        patience: float = PATIENCE,
        why: bool = False,
    ) -> None:
        self._why = why
        self._system = system
        self._patience = patience
        self._points = points
        self._notes: List[str] = []
        self._number = 0
        self._earlier = ""

    def run(self, trial: Trial) -> Result:
        """Carries a trial out; bounded in time, whatever hangs."""
        watchdog = threading.Timer(TRIAL_LIMIT, self._system.kill, [f"no end after {TRIAL_LIMIT:.0f} s"])
        watchdog.name, watchdog.daemon = "watchdog", True
        watchdog.start()
        number = self._take_number()
        course = _Course(self._system, trial, self._points, self._notes, number, self._patience, self._why)
        try:
            return course.run()
        except LogClosed as closed:
            broken = Judgement((f"the trial was broken off: {closed}",), None, None, None, "")
            return Result(trial, broken, log=course.log)
        except (BrokenBefore, NotRunning) as broken_before:
            return failed_before(trial, broken_before, self._earlier, course.log)
        except (Missed, LookupError, StartError) as missed:
            return Result(trial, None, f"not valid: {missed}")
        finally:
            self._earlier = trial.label
            watchdog.cancel()

    def _take_number(self) -> int:
        self._number += 1
        return self._number


class _Course(Watching):
    """One trial under way."""

    def __init__(
        self,
        system: System,
        trial: Trial,
        points: Dict[str, Tuple[float, float]],
        notes: List[str],
        number: int,
        patience: float,
        why: bool,
    ) -> None:
        super().__init__(system)
        self._why = why
        self._patience = patience
        self._trial = trial
        self._points = points
        self._notes = notes
        self._note = f"n{number % 20}"
        self._random = random.Random(f"trial {trial.seed}")
        self._injector: Optional[Injector] = None
        self._looks = 0
        self._late: Set[int] = set()

    @property
    def log(self) -> List[Event]:
        """What has happened since its begin."""
        return self._log.since(self._begin)

    def run(self) -> Result:
        """Carries it out and judges it."""
        trial = self._trial
        try:
            self._prepare()
            goals = self._goals() if REQUESTS[trial.moment] is not None else []
            before = self._log.since(0)  # what the request does may come while it is being sent
            if goals:
                self._send(REQUEST, goals)
            at_once = trial.joined and self._random.random() < 0.5
            if at_once:
                self._send_joined()
            self._await_moment(before)
            if trial.joined and not at_once:
                self._send_joined()
            self._injector = Injector(self._system, trial.fault, trial.alone)
            fault_at = self._await_delay_and_strike()
            if REQUESTS[trial.moment] is None and trial.goals:
                self._send(REQUEST, self._goals())
            self._follow_request(fault_at)
            if trial.joined:
                self._follow_joined()
            helped = self._repair(fault_at)
            if trial.variant.planner:
                # Without a planner there is no next goal, but there are processes.
                words = (f"{trial.variant.planner}.py", PLANNER_CHILD)
                left = {pid for word in words for pid in processes.with_word(self._system.run, word)}
                self._report(events.LEFT, count=len(left))
            else:
                if trial.fault.takes_what_nodes_need:
                    # A node that cannot serve has to notice, to end and to be back first.
                    self._probe_nodes(self._patience * NODES_LIMIT)
                if trial.stop and not trial.fault.touches_guard:
                    self._drive_stop()
                self._next_goal()
        finally:
            if self._injector is not None:
                self._injector.end()
        self._pause(SETTLE)
        self._look()
        self._await_nodes()
        if trial.stop and trial.fault.touches_guard:
            self._drive_stop()  # only now it is surely back
        if self._why:
            self._ask_why(goals)
        self._report(events.CLOSED)
        log = [event for event in self._log.since(self._begin) if not self._too_late(event)]
        judgement = judge(Evidence(trial, log, self._points, self._notes, self._patience))
        note = "; ".join(f"{event['do']}: {event['error']}" for event in log if event.kind == "failed")
        return Result(trial, judgement, note, log, ", ".join(helped), os.getloadavg()[0])

    # ------------------------------------------------------------------------------------ before the fault

    def _prepare(self) -> None:
        """One fact more that must not be lost; what the moment needs is made true or false."""
        note = f"(noted {self._note})"
        add, remove = [note], [f"(said {self._note})", f"(heard {self._note})", f"(quitted {self._note})"]
        if REQUESTS[self._trial.moment] == LISTEN:
            add.append(remove.pop(0))
        remove += [f"({name} {place})" for name in DRIVES for place in self._points]
        # The planner has no reason to prefer the drives that behave.
        odd = any(name in goal for name in DRIVES for goal in self._trial.goals)
        (add if odd else remove).append("(odd)")
        if self._trial.variant.robots:
            remove = []  # of another domain
        remove += [f"(said {note})" for note in JOINED_NOTES if self._trial.joined]
        if self._trial.stop:
            self._system.tell_witness(do="locate", services=["merlin/stop", "merlin/release"])
        if self._trial.fault.kind == DISK_FULL:
            remove += WRITTEN_FACTS
        self._system.tell_client(do="prepare", add=add, remove=remove)
        prepared = self._find("prepared", 15.0)
        if prepared is None or prepared.kind == "failed":
            why = prepared["error"] if prepared else "no answer"
            raise BrokenBefore(f"the knowledge base takes no facts: {why}")
        self._notes[:] = sorted({*self._notes, note} - set(remove))

    def _goals(self) -> List[str]:
        robots = self._trial.variant.robots
        if robots and REQUESTS[self._trial.moment] is not None:
            return [f"(robot_at {robot} {place})" for robot, place in zip(robots, self._far_places())]
        if self._trial.goals:
            return [goal.format(place=self._far_place(), note=self._note) for goal in self._trial.goals]
        request = REQUESTS[self._trial.moment]
        if request == DRIVE:
            return [f"(robot_at {self._far_place()})"]
        return [f"(said {self._note})" if request == SPEAK else f"(heard {self._note})"]

    def _far_place(self) -> str:
        """A place to drive to, away from where the robot is."""
        return self._far_places()[0]

    def _far_places(self) -> List[str]:
        """The places to drive to, in random order."""
        truth = scene_at(self._log.since(0), time.monotonic()).truth
        if truth is None:
            raise Missed("there is no ground truth")
        far = [
            name
            for name, (x, y) in sorted(self._points.items())
            if ((truth["x"] - x) ** 2 + (truth["y"] - y) ** 2) ** 0.5 > FAR
        ]
        return self._random.sample(far, len(far))

    def _send(self, label: str, goals: List[str]) -> None:
        self._system.tell_client(do="send", label=label, goals=goals)

    def _send_joined(self) -> None:
        deadlines = [self._random.choice(DEADLINES), None]
        for label, note, deadline in zip(JOINED, JOINED_NOTES, deadlines):
            self._system.tell_client(do="send", label=label, goals=[f"(said {note})"], deadline=deadline)

    def _await_moment(self, before: List[Event]) -> None:
        trial, scene, position = self._trial, Scene(), len(before)
        for event in before:
            scene.apply(event)
        if holds(trial.moment, scene):
            return
        if trial.moment is Moment.CANCELLING:
            self._await(lambda event: self._applied(scene, event, Moment.DRIVING), position)
            position = self._log.position()
            self._system.tell_client(do="cancel", label=REQUEST)
        self._await(lambda event: self._applied(scene, event, trial.moment), position)

    def _await_nodes(self) -> None:
        """What has died is back: the next trial must not find it missing."""
        end = time.monotonic() + self._patience * NODES_LIMIT
        while self._system.missing_nodes() and time.monotonic() < end:
            self._pause(LOOK_PERIOD)
        self._report(events.MISSING, nodes=self._system.missing_nodes())

    @staticmethod
    def _applied(scene: Scene, event: Event, moment: Moment) -> Optional[bool]:
        scene.apply(event)
        return True if begins(moment, scene, event) else None

    def _await(self, find: Callable[[Event], Optional[bool]], position: int) -> None:
        ended: List[Event] = []

        def look(event: Event) -> Optional[bool]:
            if event.kind == events.ENDED and event["label"] == REQUEST:
                ended.append(event)
                return True
            return find(event)

        found = self._log.wait_for(position, look, time.monotonic() + MOMENT_LIMIT, time.monotonic)
        if found is None:
            raise BrokenBefore(
                f"the moment '{self._trial.moment.value}' did not come in {MOMENT_LIMIT:.0f} s"
            )
        if ended:
            raise ended_before(ended[0])

    def _await_delay_and_strike(self) -> float:
        trial = self._trial
        self._pause(trial.delay)
        scene = scene_at(self._log.since(0), time.monotonic())
        if WINDOWS[trial.moment].holds and not holds(trial.moment, scene):
            raise Missed(f"the moment '{trial.moment.value}' was over before the fault")
        assert self._injector is not None
        at = self._injector.strike()
        if trial.cancel:
            self._system.tell_client(do="cancel", label=REQUEST)
        elif trial.joined and trial.moment is not Moment.CANCELLING and self._random.random() < 0.5:
            self._system.tell_client(do="cancel", label=self._random.choice(JOINED))
        return at

    # ------------------------------------------------------------------------------------ after the fault

    def _follow_request(self, fault_at: float) -> None:
        """Until the request has ended; one without a cancel is cancelled when it continues too long."""
        trial = self._trial
        if REQUESTS[trial.moment] is None and not trial.goals:
            self._pause(SETTLE)
            return
        if CLIENT in trial.fault.targets and trial.fault.lasts is None:
            self._until(events.STATUS, fault_at, ANSWER_WATCH, lambda event: event["state"] == 0)
            return
        cancelled = trial.cancel or trial.moment is Moment.CANCELLING
        if not cancelled:
            lasts = min(trial.fault.lasts or 0.0, 10.0)
            goes_on = lasts + (GOES_ON_MASTER if MASTER in trial.fault.targets else GOES_ON)
            if trial.fault.takes_owner and trial.fault.hangs:
                # A base that must not drive is watched for as long as a starved machine may need to stop it.
                goes_on = max(goes_on, self._patience * STAND_LIMIT_HUNG + SETTLE)
            untold = FAILING_WATCH if self._why else UNTOLD_WATCH
            if self._ended_or_drives(fault_at + goes_on, untold + lasts):
                return
            self._system.tell_client(do="cancel", label=REQUEST)
        # What a starved machine may need, too: help would end what hangs, and hide that it does.
        self._ended(REQUEST, max(ANSWER_WATCH, self._patience * ANSWER_LIMIT + SETTLE))

    def _follow_joined(self) -> None:
        """Until the others have ended, too; what continues too long is cancelled."""
        if CLIENT in self._trial.fault.targets and self._trial.fault.lasts is None:
            return
        for label in JOINED:
            if not self._ended(label, ANSWER_WATCH):
                self._system.tell_client(do="cancel", label=label)
                self._ended(label, max(ANSWER_WATCH, self._patience * ANSWER_LIMIT + SETTLE))

    def _repair(self, fault_at: float) -> List[str]:
        """Waits for the end of a fault that ends by itself; repairs one that does not."""
        trial, injector = self._trial, self._injector
        assert injector is not None
        self._pause(SETTLE)
        if trial.fault.lasts is not None and not injector.over:
            left = fault_at + trial.fault.lasts + 1.0 - time.monotonic()
            self._find(events.OVER, max(0.0, left))
        if trial.fault.kind == DISK_FULL:
            self._restart_knowledge()
        lasting = trial.fault.lasts is None and trial.fault.kind not in (NONE, SECOND_NODE)
        helped = injector.help() if lasting else []
        if MASTER in trial.fault.targets and helped:
            self._report(events.HELPED, what="a new master knows no node")
        return helped

    def _restart_knowledge(self) -> None:
        """Has the knowledge base read its file: what it has acknowledged is there."""
        written = (event for event in self._log.since(self._begin) if event.kind == events.WRITTEN)
        self._notes += [event["fact"] for event in written if not event["error"]]
        knowledge = self._system.pid("planning_system")
        if knowledge is not None:  # else it has ended itself, and reads the file when it is back
            processes.send(knowledge, SIGNALS["KILL"])
        self._pause(SETTLE)

    def _ask_why(self, goals: List[str]) -> None:
        """Has the robot say why the request failed, if it did."""
        ended = [event for event in self.log if event.kind == events.ENDED and event["label"] == REQUEST]
        if goals and asked_about(self._trial.fault, [event["outcome"] for event in ended]):
            self._system.tell_client(do="why", goal=goals[0])
            self._find(events.WHY, WHY_WATCH)

    def _next_goal(self) -> None:
        self._report(events.NEXT)
        self._look_until_settled()
        ready = self._log.position()
        robot = "".join(f"{robot} " for robot in self._trial.variant.robots[:1])
        self._send(NEXT, [f"(robot_at {robot}{self._far_place()})"])
        if not self._next_begins(ready):
            self._system.tell_client(do="cancel", label=NEXT)
            self._ended(NEXT, ANSWER_WATCH / 2)
            return
        self._system.tell_client(do="cancel", label=NEXT)
        self._ended(NEXT, ANSWER_WATCH)

    def _next_begins(self, position: int) -> bool:
        """Whether the base drives to the next goal before the time is over or the request has ended."""
        scene = Scene()

        def find(event: Event) -> Optional[bool]:
            scene.apply(event)
            if event.kind == events.ENDED and event["label"] == NEXT:
                return False
            return True if scene.speed > DRIVING_SPEED and scene.active.get("move_base") else None

        until = time.monotonic() + self._patience * NEXT_LIMIT_HELPED + NEXT_MARGIN
        found = self._log.wait_for(position, find, until, time.monotonic)
        return bool(found)

    def _look_until_settled(self) -> None:
        """What was restarted, by itself or by help, puts its knowledge right first."""
        end, answered = time.monotonic() + LOOK_WATCH, False
        while True:
            facts = self._look()
            if facts is not None and settled(facts, self._trial.variant.robots):
                return
            if facts is not None and "error" not in facts.data and not answered:
                # On a starved machine it may have taken all the time to come back.
                end, answered = max(end, time.monotonic() + FACTS_LIMIT), True
            if time.monotonic() >= end:
                return
            self._pause(LOOK_PERIOD)

    def _look(self) -> Optional[Event]:
        """Looks at the knowledge; None: it does not answer."""
        position = self._log.position()
        self._looks += 1
        number = self._looks
        self._system.tell_client(do="look", number=number, said=self._trial.joined)
        found = self._log.wait_for(
            position,
            lambda event: event if event.kind == events.FACTS and event["look"] == number else None,
            time.monotonic() + LOOK_WATCH,
            time.monotonic,
        )
        if found is None:
            self._late.add(number)
            self._report(events.FACTS, look=number, error=f"no answer within {LOOK_WATCH:.0f} s")
        return found

    def _too_late(self, event: Event) -> bool:
        """Whether it answers a look that was given up."""
        answers = event.kind == events.FACTS and event["look"] in self._late
        return answers and "no answer" not in event.get("error", "")
