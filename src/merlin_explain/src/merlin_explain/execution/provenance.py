# SPDX-License-Identifier: Apache-2.0
"""Why a fact is as it is: the action or client that made it so, and the proof of a derived one."""

from typing import Collection, List

from merlin_explain.claims import FACT, Answer, Claim, Evidence, QuestionError, Words
from merlin_explain.core.wording import and_list
from merlin_explain.execution.moment import RUNNING, Change, Moment, Step, checked_about, key_of
from merlin_explain.execution.proof import proof
from merlin_explain.execution.recorded_past import RecordedPast
from merlin_pddl.formula import Atom, Condition, Fluent, Not, ground, must_hold, terms, to_pddl
from merlin_pddl.problem_reader import parse_condition

NEAR = 0.5  # s between a change and the messages about the action that made it
LOOKS = (0.0, 2 * NEAR, 16 * NEAR)  # s behind a change at which such an action is looked for
MOST = 6  # facts of a proof that are named


def provenance(
    moment: Moment, past: RecordedPast, about: str, words: Words, interfaces: Collection[str] = ()
) -> Answer:
    """Why a fact, a value or a condition is as it is.

    :param interfaces: the nodes that apply the effects of actions, where they are known.
    :raises QuestionError: it is no PDDL, or about something that is not in the domain.
    :raises merlin_pddl.text_reader.PddlError: likewise.
    """
    if not checked_about(about):
        raise QuestionError('say which fact: "(robot_at kitchen)"')
    teller = _Teller(moment, past, words, interfaces)
    if key_of(about)[0] in moment.domain.functions and len(about.split("(")) == 2:
        return teller.value(about)
    condition = parse_condition(about, moment.domain, moment.typed(), "the question")
    if not must_hold(condition):
        raise QuestionError(f"{about} names no fact")
    return teller.condition(condition)


class _Teller:
    """Tells where facts are from.

    :param past: of before this moment.
    """

    def __init__(self, moment: Moment, past: RecordedPast, words: Words, interfaces: Collection[str]) -> None:
        self._moment = moment
        self._past = past
        self._words = words
        self._interfaces = interfaces

    def value(self, text: str) -> Answer:
        """Why a function has its value."""
        value = self._moment.value(key_of(text))
        if value is None:
            return Answer(f"{text} has no value.", (self._absent(text),))
        claim = self._origin(text)
        return Answer(f"{text} is {value:g}: {claim.text}.", (claim,))

    def condition(self, condition: Condition) -> Answer:
        """Why a condition holds, or does not."""
        what = self._words.fact(to_pddl(condition))
        if not self._moment.true(condition):
            claims = [claim for part in must_hold(condition) for claim in self._why_not(part)]
            reasons = _joined(claims, what)
            because = "" if reasons == "it does not hold" else f": {reasons}"
            return Answer(f"“{what}” does not hold{because}.", tuple(claims))
        found = proof(self._moment, condition)
        if found is None:
            return Answer(f"“{what}” holds; its proof is too long to be shown.")
        claims = [self._leaf(part) for part in found]
        if found == [condition] or not found:
            return Answer(f"“{what}” holds: {_joined(claims, what) or 'by the domain alone'}.", tuple(claims))
        facts = and_list([f"“{self._words.fact(to_pddl(part))}”" for part in found[:MOST]])
        more = f" and {len(found) - MOST} more" if len(found) > MOST else ""
        shown = tuple(each for part in found for each in self._moment.condition_evidence(part))
        derived = Claim("derived", f"the rules of the domain derive it from {facts}{more}", shown)
        return Answer(f"“{what}” holds: {derived.text}.", (derived, *claims))

    def _leaf(self, part: Condition) -> Claim:
        """Where a literal that holds is from; of a comparison, where its values are."""
        if isinstance(part, Not) and isinstance(part.part, Atom):
            return self._absent(to_pddl(part.part))
        origins = [self._origin(text) for text in _texts(part) if self._moment.entry(text) is not None]
        if isinstance(part, Atom):
            return origins[0]
        said = "; ".join(claim.text for claim in origins) or f"{to_pddl(part)} is true"
        return Claim("value", said, self._moment.condition_evidence(part))

    def _why_not(self, part: Condition) -> List[Claim]:
        """Why one part of a condition does not hold; nothing where it does."""
        if self._moment.true(part):
            return []
        if isinstance(part, Not) and isinstance(part.part, Atom):
            return list(self.condition(part.part).claims)
        rules = self._moment.domain.derived.get(part.name.lower(), []) if isinstance(part, Atom) else []
        if isinstance(part, Atom) and not rules:
            return [self._absent(to_pddl(part))]
        missing, rests = [part], ""
        if isinstance(part, Atom) and len(rules) == 1:
            body = ground(
                rules[0].body, dict(zip((each.name for each in rules[0].head.parameters), part.args))
            )
            missing = [each for each in must_hold(body) if not self._moment.true(each)]
            rests = ", on which it rests"
        words, evidence = self._words.fact, self._moment.condition_evidence
        return [
            Claim("condition", f"“{words(to_pddl(each))}” does not hold{rests}", evidence(each))
            for each in missing
        ]

    # --- origins --------------------------------------------------------------------------------------------

    def _origin(self, text: str) -> Claim:
        """Who made a fact true, or gave a function its value."""
        entry = self._moment.entry(text) or {}
        shown = self._moment.fact_evidence(text)
        if not entry.get("at"):
            said = f"“{self._words.fact(text)}” has been so since before the recording began"
            return Claim("origin", said, (shown,))
        version = int(entry.get("version") or 0)
        by, after = str(entry.get("by") or ""), entry.get("after")
        return self._made(Change("+", text, by, float(entry["at"]), version, after))

    def _absent(self, text: str) -> Claim:
        """Who made a fact false."""
        shown = Evidence(FACT, f"(not {text})", 0, self._moment.version, self._moment.at)
        try:
            change = self._past.change(text)
        except TimeoutError:
            said = (
                f"whether “{self._words.fact(text)}” was true before is not known, as the recording is long"
            )
            return Claim("absent", said, (shown,))
        if change is not None and change.sign == "-":
            return self._made(change)
        said = f"nothing has made “{self._words.fact(text)}” true as far as the recording shows"
        return Claim("absent", said, (shown,))

    def _made(self, change: Change) -> Claim:
        steps = self._actions(change, change.sign != "-")
        if len(steps) == 1:
            return change.claim(self._words, steps[0].evidence(), by=f"“{self._words.step(steps[0].text)}”")
        return change.claim(self._words)

    def _actions(self, change: Change, positive: bool) -> List[Step]:
        """The steps that ran then and whose effects have this change."""
        if change.client not in self._interfaces:
            return []
        key = key_of(change.text)
        found = {}
        # The next plan may come at once, and the begin be noted later, much later by a monitor that hangs.
        for then in (*(self._past.at(change.at + late) for late in LOOKS), self._moment):
            for step in then.steps if then else ():
                if then and _ran(step, change.at) and (key, positive) in then.effects(step):
                    found[step.text] = step
        return list(found.values())


def _ran(step: Step, at: float) -> bool:
    """Whether a step ran at a time, s of ROS time."""
    if step.began is None or step.began > at + NEAR:
        return False
    return step.state in RUNNING or (step.ended is not None and at <= step.ended + NEAR)


def _texts(part: Condition) -> List[str]:
    """The facts and functions in a condition."""
    return [to_pddl(term) for term in terms(part) if isinstance(term, (Atom, Fluent))]


def _joined(claims: List[Claim], what: str) -> str:
    """The first claims, which name a fact that was named before no second time."""
    return "; ".join(claim.text for claim in claims[:3]).replace(f"“{what}”", "it")
