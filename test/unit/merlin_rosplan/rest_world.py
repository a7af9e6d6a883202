# SPDX-License-Identifier: Apache-2.0
"""A knowledge store whose changes a watch over the rest of a plan hears, and the actions of that plan."""

from dispatch_world import World

from merlin_pddl.checks.kairos_check import PlanValidator
from merlin_pddl.domain import Operator
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.formula import START, TimedCondition
from merlin_pddl.knowledge import Fact, Instance
from merlin_pddl.plan_text import NO_DURATION, PlanStep
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.problem_writer import write_problem
from merlin_rosplan.dispatch.dispatch_environment import KnowledgeChanged, PlanGoals
from merlin_rosplan.dispatch.dispatch_graph import SequentialSchedule
from merlin_rosplan.dispatch.dispatch_schedule import PlannedAction
from merlin_rosplan.dispatch.operator_model import ActionModel, Conditions, PlanTerm
from merlin_rosplan.knowledge.executions import Executions
from merlin_rosplan.knowledge.foreseen import after_actions
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.rest.rest_watch import PlanWatch


def planned(*texts, durations=()):
    """Actions from their PDDL text, one second after the other."""
    found = []
    for number, text in enumerate(texts):
        name, *objects = text.strip("()").split()
        duration = durations[number] if durations else NO_DURATION
        found.append(
            PlannedAction(number, name, tuple(("", each) for each in objects), duration, float(number))
        )
    return found


class RestWorld(World):
    """One plan over one store."""

    def __init__(self, domain, problem, actions, schedule=None):
        super().__init__()
        self.domain_text = domain
        self.domain = parse_domain(domain)
        self.store = KnowledgeStore(self.domain, clock=lambda: 5)
        self.store.load_problem(parse_problem(problem, self.domain))
        self.actions = actions
        self.tokens = {}
        self.lists_executions = True
        self.timed = set()
        self.watch = PlanWatch(schedule or SequentialSchedule(actions), self)
        self.listeners = [self.watch.changed]
        self.store.listen(self._changed)

    def _changed(self, change):
        rows = (*change.added, *change.removed, *change.changed)
        names = frozenset("" if isinstance(row, Instance) else row.name.lower() for row in rows)
        facts = {row.key: False for row in change.removed if isinstance(row, Fact)}
        facts.update((row.key, not row.negative) for row in change.added if isinstance(row, Fact))
        for listener in self.listeners:
            listener(KnowledgeChanged(None if change.cleared else names, frozenset(facts.items())))

    # --- what the test does -------------------------------------------------------------------------

    def make(self, *texts):
        """Another client makes literals true."""
        with self.store.transaction("other") as change:
            for text in texts:
                name, *objects = text.replace("(not ", "").strip("() ").split()
                (change.remove if text.startswith("(not") else change.add)(Fact(name, tuple(objects)))

    def start(self, number, **declared):
        """An action is sent and its interface begins it."""
        self.watch.started(number)
        self.begin(number, **declared)

    def begin(self, number, **declared):
        self._apply("start", number, **declared)
        self.tokens[number] = True

    def finish(self, number):
        """The effects of the end come true; the answer is still under way."""
        self._apply("end", number)
        self.tokens.pop(number)

    def end(self, number):
        self.finish(number)
        self.watch.ended(number)

    def _apply(self, phase, number, **declared):
        action = self.actions[number]
        labels = [each.label for each in self.domain.operators[action.name].parameters]
        binding = dict(zip(labels, (value for _, value in action.parameters)))
        with self.store.transaction("bridge") as change:
            getattr(Executions(change), phase)(f"7/{number}/x", action.name, binding, **declared)

    def problem(self, running=()):
        """The problem as PDDL text once the running actions have ended."""
        _, found = self.store.snapshot()
        return write_problem(after_actions(self.domain, found, [str(each) for each in running]), self.domain)

    def fault(self, actions, running=()):
        """What the validator says against these actions, from now on."""
        steps = [
            PlanStep(each.time, each.name, tuple(value for _, value in each.parameters), each.duration)
            for each in actions
        ]
        return PlanValidator(self.domain_text, self.problem(running)).fault(steps)

    # --- what the watch asks ------------------------------------------------------------------------

    def operator(self, action):
        operator = self.domain.operators[action.name]
        model = ActionModel.of(operator, self.domain.derived, self.domain.constraints)
        return model.ground(model.bind([value for _, value in action.parameters], action.duration))

    def false_of(self, action, conditions):
        def false(atom):
            return not self.store.query([Fact(atom.name, atom.arguments)])[0]

        return Conditions(
            tuple(atom for atom in conditions.positive if false(atom)),
            tuple(atom for atom in conditions.negative if not false(atom)),
            tuple(each for each in conditions.comparisons if not self.store.query([each.condition])[0]),
            tuple(each for each in conditions.expressions if not self.store.query([each.condition])[0]),
        )

    def held(self):
        if not self.lists_executions:
            return None
        return {
            int(found.token.split("/")[1]): frozenset(map(_term, found.meanwhile))
            for found in self.store.executions()
        }

    def next_change(self, names, until):
        return 10.0 if names & self.timed else None

    def goals(self):
        literals, reads = Conditions(), set()
        for goal in self.store.goals():
            needed = Operator("goal", (), conditions=(TimedCondition(START, goal.condition),))
            model = ActionModel.of(needed, self.domain.derived)
            literals += Conditions(model.at_start.positive, model.at_start.negative)
            others = Conditions((), (), model.at_start.comparisons, model.at_start.expressions)
            reads |= others.names
        return PlanGoals(literals, frozenset(reads))

    def goals_hold(self):
        goals = [goal.condition for goal in self.store.goals()]
        return bool(goals) and all(self.store.query(goals))

    def objects(self):
        return frozenset(name.lower() for name in self.store.objects())


def _term(text):
    name, *objects = text.replace("(not ", "").strip("() ").split()
    return PlanTerm(name, tuple(objects))
