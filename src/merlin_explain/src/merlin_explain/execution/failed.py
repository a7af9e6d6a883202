# SPDX-License-Identifier: Apache-2.0
"""Why something failed: from the words of a server through state, action and new plan to the goal."""

import contextlib
import re
from typing import Any, Iterator, List, Mapping, NamedTuple, Optional, Tuple

from merlin_explain.claims import EVENT, FACT, Answer, Claim, Evidence, QuestionError, Words
from merlin_explain.core.wording import and_list
from merlin_explain.execution.moment import ATOM, Moment, Step, checked_about, in_words, key_of
from merlin_explain.execution.recorded_past import LATER, Event, RecordedPast
from merlin_pddl.domain import Domain
from merlin_ros.work.passed_time import clock_text

KINDS = ("goal", "action", "plan")
NEAR = 0.5  # s between messages about one thing
LOOKS = (0.0, LATER, 4 * LATER, 16 * LATER)  # s behind an end at which its machine's states are looked for
_SERVER = re.compile(
    r"(?P<part>/[\w/]+) (?P<how>aborted|refused the goal|recalled the goal|was lost|was preempted by another"
    r" client|did not stop within [\d.]+ s|has been silent for [\d.]+ s|within [\d.]+ s)"
    r"(?:[^:]*: (?P<words>.+))?"
)
_FALSE = re.compile(r"(?P<fact>\([^()]+\)) (?P<how>does not hold|holds)\b")
_LIMIT = re.compile(r"did not end within [\d.]+ s and was stopped")
#: Outcome of a request → the part that ended it, and how that is said; of the others an action did.
_ENDS = {
    "cancelled": ("client", "was cancelled"),
    "dropped": ("request", "was dropped"),
    "refused": ("request", "was refused"),
    "late": ("time", "was late"),
    "unsolvable": ("planner", "has no plan"),
    "no plan": ("planner", "has no plan"),
    "planner timeout": ("planner", "was not planned"),
    "planner error": ("planner", "was not planned"),
}


class Cause(NamedTuple):
    """What a reason names.

    :ivar part: server, condition, time, client, planner, request or machine.
    :ivar text: as part of a sentence.
    :ivar fact: the fact of a condition, which was `wanted` to hold, or not to.
    """

    part: str
    text: str
    fact: str = ""
    wanted: bool = True


def cause_of(reason: str) -> Cause:
    """What the reason of an action names; the machine, with its own words, where that is nothing else."""
    server, fact = _SERVER.search(reason), _FALSE.search(reason)
    if server:
        how = "was not there" if server["how"].startswith("within") else server["how"]
        said = f": “{server['words'].strip()}”" if server["words"] else ""
        return Cause("server", f"the server {server['part']} {how}{said}")
    if fact:
        return Cause("condition", f"{fact['fact']} {fact['how']}", fact["fact"], fact["how"] != "holds")
    if _LIMIT.search(reason):
        return Cause("time", "it took longer than it may, and was stopped")
    return Cause("client" if reason.startswith("cancelled") else "machine", reason)


def failed(moment: Moment, past: RecordedPast, about: str, words: Words) -> Answer:
    """Why the last thing failed.

    :param about: an action, or a goal of a request; empty: whatever failed last.
    :raises QuestionError: nothing like that has failed.
    """
    wanted = key_of(checked_about(about))
    for event in _failures(past):
        texts = [*_named(event), *ATOM.findall(f"{event['detail'].get('label') or ''} {reason_of(event)}")]
        if not wanted or wanted in map(key_of, texts):
            events = past.events(KINDS, event["wall"])
            return _Chain(past, events, event, words, moment.domain).answer()
    what = about or "anything"
    raise QuestionError(f"the recording knows no failure of {what} up to {clock_text(moment.at)}")


def _failures(past: RecordedPast) -> Iterator[Event]:
    """What failed, newest first, a request before what ended it: their topics are heard in any order.

    What a planner said of a request that ended by it counts as part of that.
    """
    later: List[Event] = []  # parts that may belong to a request that ended just before they were heard
    for event in past.failures(KINDS):
        while later and _behind(later[0], event) > NEAR:
            yield later.pop(0)
        if event["kind"] != "goal":
            later.append(event)
            continue
        yield from (each for each in later if not (_no_plan(each) or _is_cause(each, event)))
        yield event
        yield from (each for each in later if not _no_plan(each) and _is_cause(each, event))
        later = []
    yield from later


def _behind(part: Event, event: Event) -> float:
    """How long a part came behind an event, s.

    What has no stamp has the time at which the monitor hears it, and is late when the monitor hangs; the
    event is then recorded with it.
    """
    return float(min(part["at"] - event["at"], abs(part["wall"] - event["wall"])))


def _is_cause(part: Event, request: Event) -> bool:
    """Whether the reason of a request is that of an action, or of a new plan."""
    reason = reason_of(request)
    named = key_of(str(part["detail"].get("label"))) in map(key_of, ATOM.findall(reason))
    return named or reason_of(part) in reason


def _named(event: Event) -> List[str]:
    """The goals of a request, or the action."""
    return [each for each in str(event["detail"].get("label") or "").split(", ") if each]


def _no_plan(event: Event) -> bool:
    """Whether a planner found none."""
    return (event["kind"], event["mark"]) == ("plan", "failure")


def reason_of(event: Event) -> str:
    """The reason of an event in the words of the node that gave it; older recordings have only the text."""
    return str(event["detail"].get("reason") or event["text"])


class _Chain:
    """The claims about one failure.

    :param event: of the end of a request or of an action, or of a new plan.
    """

    def __init__(
        self, past: RecordedPast, events: List[Event], event: Event, words: Words, domain: Domain
    ) -> None:
        self._past = past
        self._event = event
        self._words = words
        self._domain = domain
        detail = event["detail"]
        began = float(detail.get("began", event["at"])) - NEAR
        self._within = [each for each in events if began <= each["at"] and _behind(each, event) <= NEAR]
        self._is_goal = event["kind"] == "goal"
        self._outcome = str(detail.get("outcome") or "") if self._is_goal else ""
        self._action = self._find_action()

    def answer(self) -> Answer:
        """The chain, from its begin."""
        event, action = self._event, self._action
        root = reason_of(action or event)
        part, ended = _ENDS.get(self._outcome, ("", "failed"))
        part = "planner" if _no_plan(event) else part
        cause = Cause(part, root) if part else cause_of(root)
        cancels = [each for each in self._within if _is_cancel(each)] if cause.part == "client" else []
        shown = tuple(map(_shown, cancels)) + (_shown(action or event, root),)
        text = cancels[-1]["text"] if cancels else self._in_words(cause.text)
        claims = [Claim(cause.part, text, shown)]
        because, replans = claims[0].text, self._replans()
        claims += self._facts(cause, root) if cause.fact else []
        if action is not None:
            because = f"“{self._label(action)}” failed: {because}"
            text = f"“{self._label(action)}” failed at {clock_text(action['at'])}"
            claims += [*self._states(action), Claim("action", text, (_shown(action),))]
        claims += replans
        if not self._is_goal:
            what = "No plan was found" if _no_plan(event) else "The plan was replaced"
            first = "" if action is not None else f"{what} at {clock_text(event['at'])}: "
            return Answer(f"{first}{because}.", tuple(claims))
        goal = self._label(event)
        text = f"“{goal}” ended at {clock_text(event['at'])}: {self._outcome}"
        claims.append(Claim("goal", text, (_shown(event, reason_of(event)),)))
        again = f", after {len(replans)} new plan{'s'[: len(replans) - 1]}" if replans else ""
        return Answer(f"“{goal}” {ended}{again}: {because}.", tuple(claims))

    def _find_action(self) -> Optional[Event]:
        """The action that made it fail: the last one, when the reason is that of this action."""
        if self._event["kind"] == "action":
            return self._event
        found = [each for each in self._within if (each["kind"], each["mark"]) == ("action", "failure")]
        if not found or self._outcome in ("cancelled", "dropped", "refused", "late"):
            return None
        return found[-1] if _is_cause(found[-1], self._event) else None

    def _states(self, action: Event) -> List[Claim]:
        """The states of the action's machine that ended with something else than success, the inner first."""
        detail = action["detail"]
        name = str(detail.get("label") or "").strip("()").split()[0]
        # Heard later, on a topic of its own; by then another run may have begun, which does not count.
        for late in LOOKS:
            then = self._past.after({**action, "wall": action["wall"] + late})
            ended = detail.get("ended", 0.0) - (NEAR if late else 0.0)
            left = list(_left_states(then, name, {**detail, "ended": ended}))
            if left:
                return [Claim("state", text, (Evidence(EVENT, text, time=at),)) for text, at in left]
        return []

    def _replans(self) -> List[Claim]:
        return [
            Claim(
                "replan",
                f"at {clock_text(each['at'])} it was planned again: {self._in_words(reason_of(each))}",
                (_shown(each),),
            )
            for each in self._within
            if each["mark"] == "replan" and each is not self._event
        ]

    def _facts(self, cause: Cause, reason: str) -> List[Claim]:
        """Who made the fact so, and that the action could have been carried out without this."""
        then, atom = self._past.after(self._event), key_of(cause.fact)
        if then.holds(atom) is cause.wanted:
            return []  # it has changed since: nothing can be shown
        claims = []
        change = None
        with contextlib.suppress(TimeoutError):
            change = self._past.change(cause.fact, self._event["at"] + NEAR)
        if change is not None and (change.sign == "-") is cause.wanted:
            claims.append(change.claim(self._words))
        step = self._step(then, reason)
        if step is not None and then.unmet(step) and not then.with_fact(atom, cause.wanted).unmet(step):
            wish = f"“{self._words.fact(cause.fact)}” {'held' if cause.wanted else 'not held'}"
            text = f"had {wish}, all conditions of “{self._words.step(step.text)}” would have been true"
            fact = cause.fact if cause.wanted else f"(not {cause.fact})"
            shown = (Evidence(FACT, fact, 0, then.version, then.at), step.evidence())
            claims.append(Claim("otherwise", text, shown))
        return claims

    def _step(self, then: Moment, reason: str) -> Optional[Step]:
        """The step that a reason names."""
        texts = ATOM.findall(f"{reason} {self._event['detail'].get('label') or ''}")
        return next(filter(None, map(then.step, texts)), None)

    def _label(self, event: Event) -> str:
        words = self._words.goal if event["kind"] == "goal" else self._words.step
        return and_list([words(each) for each in _named(event)])

    def _in_words(self, reason: str) -> str:
        return in_words(reason, self._domain, self._words)


def _shown(event: Event, text: str = "") -> Evidence:
    return Evidence(EVENT, text or event["text"], time=float(event["at"]))


def _is_cancel(event: Event) -> bool:
    """Whether a client takes a request back."""
    said = event["detail"].get("said")
    return isinstance(said, dict) and str(said.get("say", "")).startswith("{client} cancels")


def _left_states(then: Moment, operator: str, detail: Mapping[str, Any]) -> Iterator[Tuple[str, float]]:
    """With which states the machine of an action ended, and when, inside of it the inner ones first."""
    containers = (then.section("machines").get("containers") or {}).values()
    name = operator.replace("-", "_").upper()
    paths = {each["path"].strip("/") for each in containers if "/" not in each["path"].strip("/")}
    path = next((each for each in paths if each.upper() == name or each.upper().endswith(f"_{name}")), "")
    found: List[Tuple[str, float]] = []
    while True:
        steps = [each.get("steps") or {} for each in containers if each["path"].strip("/") == path]
        last = steps[0][max(steps[0], key=int)] if len(steps) == 1 and steps[0] else None
        if last is None:  # or of several robots' machines it is not known which
            return reversed(found)
        outcomes, began, ended = last["outcome"], detail.get("began", 0.0), detail.get("ended", 0.0)
        if not outcomes or "succeeded" in outcomes or not began - NEAR <= last["at"] <= ended + NEAR:
            return reversed(found)
        path = f"{path}/{last['state']}"
        found.append((f"state {path} ended with {' or '.join(outcomes)}", float(last["at"])))
