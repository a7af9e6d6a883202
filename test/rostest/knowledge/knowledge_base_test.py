# SPDX-License-Identifier: Apache-2.0
"""The knowledge base and the problem interface as ROSPlan's clients see them, in a robot's namespace."""

import threading
import unittest

import rospy
from diagnostic_msgs.msg import KeyValue
from merlin_msgs.msg import KnowledgeChanges, Lease
from merlin_msgs.srv import ApplyEffects, ApplyEffectsRequest
from rosplan_dispatch_msgs.srv import ProblemService
from rosplan_knowledge_msgs.msg import DomainFormula, DomainInequality, ExprBase, ExprComposite, StatusUpdate
from rosplan_knowledge_msgs.msg import KnowledgeItem as Item
from rosplan_knowledge_msgs.srv import (
    GetAttributeService,
    GetDomainAttributeService,
    GetDomainNameService,
    GetDomainOperatorDetailsService,
    GetDomainOperatorService,
    GetDomainPredicateDetailsService,
    GetDomainTypeService,
    GetInstanceService,
    GetMetricService,
    KnowledgeQueryService,
    KnowledgeUpdateService,
    KnowledgeUpdateServiceArray,
    SetNamedBool,
)
from rosplan_knowledge_msgs.srv import KnowledgeUpdateServiceRequest as Update
from std_msgs.msg import String
from std_srvs.srv import Empty, Trigger

from merlin_ros.actions.lease_holder import LeaseHolder
from merlin_test.knowledge_fixture import (
    KB,
    LONG,
    Received,
    call,
    comparison,
    fact,
    function,
    instance,
    number,
    operator,
    travel_time,
)
from merlin_test.topic_links import wait_for_connections

LENIENT = "lenient_knowledge_base"


class KnowledgeBaseTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.wait_for_service(f"{KB}/apply_effects", LONG)
        rospy.wait_for_service(f"{LENIENT}/apply_effects", LONG)
        rospy.wait_for_service("problem_over_ros/problem_generation_server_params", LONG)
        rospy.wait_for_service("rosplan_problem_interface/problem_generation_server_params", LONG)

    def setUp(self):
        self.update([Update.REMOVE_KNOWLEDGE], [fact("checked", "")])
        self.update([Update.REMOVE_GOAL], [fact("")])

    def update(self, kinds, items, base=KB):
        return call("update_array", KnowledgeUpdateServiceArray, kinds, items, base=base).success

    def propositions(self, name=""):
        found = call("state/propositions", GetAttributeService, name).attributes
        return [(item.attribute_name, [v.value for v in item.values], item.is_negative) for item in found]

    def query(self, *items):
        return call("query_state", KnowledgeQueryService, list(items))

    def test_domain(self):
        self.assertEqual(call("domain/name", GetDomainNameService).domain_name, "home")
        types = call("domain/types", GetDomainTypeService)
        self.assertEqual((types.types, types.super_types), (["place", "poi"], ["object", "place"]))
        predicates = call("domain/predicates", GetDomainAttributeService).items
        self.assertEqual([p.name for p in predicates], ["in_service", "robot_at", "checked"])
        self.assertEqual(predicates[2].typed_parameters, [KeyValue("p", "poi")])
        functions = call("domain/functions", GetDomainAttributeService).items
        self.assertEqual([p.key for p in functions[0].typed_parameters], ["from", "to"])
        operators = call("domain/operators", GetDomainOperatorService).operators
        self.assertEqual([o.name for o in operators], ["navigate", "ask"])
        op = call("domain/operator_details", GetDomainOperatorDetailsService, "navigate").op
        self.assertEqual(op.at_start_del_effects, [DomainFormula("robot_at", [KeyValue("from", "place")])])
        self.assertEqual(op.at_end_add_effects, [DomainFormula("robot_at", [KeyValue("to", "poi")])])
        self.assertEqual(op.at_start_simple_condition[0].typed_parameters[0].key, "from")
        with self.assertRaises(rospy.ServiceException) as caught:
            call("domain/operator_details", GetDomainOperatorDetailsService, "navigat")
        self.assertIn("did you mean 'navigate'", str(caught.exception))
        with self.assertRaises(rospy.ServiceException):
            call("domain/predicate_details", GetDomainPredicateDetailsService, "travel_time")

    def test_instances(self):
        pois = ["dorm_room", "bathroom", "kitchen", "main_door"]
        for kind, constants, subtypes, expected in (
            ("poi", False, False, pois),
            ("place", False, False, []),
            ("place", True, False, ["anywhere"]),
            ("place", True, True, [*pois, "anywhere"]),
            ("", False, False, pois),
            ("unknown", True, True, []),
        ):
            found = call("state/instances", GetInstanceService, kind, constants, subtypes).instances
            self.assertEqual(found, expected, (kind, constants, subtypes))
        self.assertTrue(self.update([0, 0], [instance("poi", "balcony"), fact("checked", "Balcony")]))
        self.assertTrue(self.query(instance("poi", "balcony"), instance("place", "balcony")).all_true)
        self.assertTrue(self.update([Update.REMOVE_KNOWLEDGE], [instance("poi", "balcony")]))
        self.assertEqual(self.propositions("checked"), [])

    def test_facts_with_labels_of_the_domain(self):
        self.assertTrue(self.update([0, 0], [fact("checked", "kitchen"), fact("checked", "bathroom")]))
        self.assertTrue(self.update([0], [fact("checked", "kitchen")]))
        found = call("state/propositions", GetAttributeService, "checked").attributes
        self.assertEqual(
            [item.values for item in found], [[KeyValue("p", "kitchen")], [KeyValue("p", "bathroom")]]
        )
        self.assertNotEqual(found[0].initial_time, rospy.Time(0))
        answer = self.query(fact("checked", "kitchen"), fact("checked", "main_door"))
        self.assertEqual((answer.all_true, list(answer.results)), (False, [True, False]))
        self.assertEqual([v.value for v in answer.false_knowledge[0].values], ["main_door"])
        self.assertTrue(self.query(fact("checked", "main_door", negative=True)).all_true)
        self.assertTrue(self.query(fact("checked", "", negative=False)).all_true)

    def test_what_is_refused_changes_nothing(self):
        before = self.propositions()
        bad = [
            fact("cheked", "kitchen"),
            fact("checked", "kitchn"),
            fact("checked"),
            fact("checked", ""),
            fact("checked", "anywhere"),
            instance("table", "t"),
            travel_time("kitchen", "moon", 3.0),
            Item(knowledge_type=9),
        ]
        for item in bad:
            self.assertFalse(call("update", KnowledgeUpdateService, 0, item).success, item)
            self.assertFalse(self.update([0, 0], [fact("checked", "kitchen"), item]), item)
        self.assertFalse(call("update", KnowledgeUpdateService, 77, fact("checked", "kitchen")).success)
        self.assertFalse(self.update([0], []))
        self.assertEqual(self.propositions(), before)
        self.assertTrue(self.update([Update.REMOVE_KNOWLEDGE], [fact("nobody", "knows", "this")]))

    def test_arguments_are_named_by_the_declared_keys(self):
        item = travel_time("", "", 77.0)
        item.values = [KeyValue("to", "kitchen"), KeyValue("from", "anywhere")]
        before = self.one_travel_time("anywhere", "kitchen")
        self.assertTrue(self.update([0], [item]))
        self.assertEqual(self.one_travel_time("anywhere", "kitchen"), 77.0)
        self.assertTrue(self.query(item).all_true)
        self.assertTrue(self.update([0], [travel_time("anywhere", "kitchen", before)]))
        item.values[1].key = "p1"
        self.assertFalse(call("update", KnowledgeUpdateService, 0, item).success)
        self.assertIn("the keys of 'travel_time' are 'to', 'p1'", call("last_refusal", Trigger).message)

    def one_travel_time(self, start, end):
        for item in call("state/functions", GetAttributeService, "travel_time").attributes:
            if [pair.value for pair in item.values] == [start, end]:
                return item.function_value
        self.fail(f"from {start} to {end} there is no travel time")

    def test_lenient_knowledge_base_accepts_everything(self):
        for item in (fact("new", "a", ""), instance("table", "t"), travel_time("x", "y", 3.0)):
            self.assertTrue(self.update([0], [item], base=LENIENT))
        self.assertTrue(call("update", KnowledgeUpdateService, 77, fact("x"), base=LENIENT).success)
        found = call("state/propositions", GetAttributeService, "new", base=LENIENT).attributes
        self.assertEqual(found[0].values, [KeyValue("some text", "a"), KeyValue("some text", "")])
        call("clear", Empty, base=LENIENT)
        self.assertEqual(call("state/propositions", GetAttributeService, "", base=LENIENT).attributes, [])

    def test_numbers(self):
        self.assertTrue(self.query(travel_time("kitchen", "bathroom")).all_true)
        self.assertTrue(self.update([0], [travel_time("kitchen", "bathroom", 31.0)]))
        raised = travel_time("kitchen", "bathroom", 2.0)
        raised.assign_op = Item.AP_SCALE_UP
        self.assertTrue(self.update([0], [raised]))
        found = call("state/functions", GetAttributeService, "travel_time").attributes
        values = {tuple(v.value for v in item.values): item.function_value for item in found}
        self.assertEqual(values["kitchen", "bathroom"], 62.0)
        path = function("travel_time", "kitchen", "bathroom")
        left = ExprComposite([*operator(ExprBase.SUB), *path, *number(2.0).tokens])
        nested = ExprComposite([*operator(ExprBase.MUL), *left.tokens, *operator(ExprBase.UMINUS), *path])
        ask = comparison
        self.assertEqual(
            list(
                self.query(
                    ask(DomainInequality.EQUALS, left, number(60.0)),
                    ask(DomainInequality.LESS, nested, number(-3719.0)),
                    ask(DomainInequality.GREATER, nested, number(-3719.0)),
                    ask(DomainInequality.GREATER, ExprComposite(), number(1.0)),
                    ask(
                        DomainInequality.GREATER,
                        ExprComposite(function("travel_time", "a", "b")),
                        number(-1.0),
                    ),
                ).results
            ),
            [True, True, False, False, False],
        )
        self.update([0], [travel_time("kitchen", "bathroom", 25.0)])

    def test_goals_go_with_their_owner(self):
        changes = Received(f"{KB}/changes", KnowledgeChanges)
        topic = f"{KB}/goals/lease"
        publisher = rospy.Publisher(topic, Lease, queue_size=10)
        wait_for_connections(publisher)

        def begin_life(name, *leases):
            publisher.publish(Lease(owner=rospy.get_name(), life=name, held=list(leases)))

        def removed(place):
            message = changes.wait(lambda change: place in places(change.goals_removed))
            return places(message.goals_removed)

        def places(goals):
            return [goal.values[0].value for goal in goals]

        kinds, goals = [Update.ADD_GOAL] * 3, ["kitchen", "bathroom", "main_door"]
        self.assertTrue(self.update(kinds, [fact("checked", place) for place in goals]))
        begin_life("first", "1 (and (checked kitchen) (checked bathroom))", "2 no PDDL", "3 (checked)")
        holder = LeaseHolder(topic)
        holder.hold("1 (and (checked kitchen))")  # its process was restarted, and wants one of them again
        self.assertEqual(removed("bathroom"), ["bathroom"])
        holder.hold("2 (and (checked main_door))")
        holder.release("1 (and (checked kitchen))")  # a client that lets go leaves its goals
        begin_life("third")
        self.assertEqual(removed("main_door"), ["main_door"])
        self.assertEqual(places(call("state/goals", GetAttributeService, "").attributes), ["kitchen"])
        holder.shutdown()
        publisher.unregister()
        changes.close()

    def test_goals_come_back_and_reach_the_problem(self):
        more = comparison(
            DomainInequality.GREATER,
            ExprComposite(function("travel_time", "kitchen", "bathroom")),
            number(5.0),
        )
        either = Item(
            knowledge_type=Item.EXPRESSION, attribute_name="(or (checked kitchen) (checked bathroom))"
        )
        goals = [fact("checked", "kitchen"), fact("robot_at", "kitchen", negative=True), more, either]
        self.assertTrue(self.update([Update.ADD_GOAL] * 4, goals))
        found = call("state/goals", GetAttributeService, "ignored").attributes
        self.assertEqual([item.knowledge_type for item in found], [Item.FACT, Item.FACT, Item.INEQUALITY, 3])
        self.assertEqual(list(self.query(*found).results), [False, True, True, False])
        expected = (
            "(:goal (and\n    (checked kitchen)\n    (not (robot_at kitchen))\n"
            "    (> (travel_time kitchen bathroom) 5)\n    (or (checked kitchen) (checked bathroom))\n))"
        )
        for node in ("rosplan_problem_interface", "problem_over_ros"):
            answer = call("problem_generation_server_params", ProblemService, "", True, base=node)
            self.assertTrue(answer.problem_generated)
            self.assertIn(expected, answer.problem_string, node)
            self.assertIn("(:metric minimize (total-time))", answer.problem_string)
            latched = rospy.wait_for_message(f"{node}/problem_instance", String, LONG)
            self.assertEqual(latched.data, answer.problem_string)
        self.assertTrue(self.update([Update.REMOVE_GOAL] * 2, [fact("checked", ""), either]))
        self.assertEqual(len(call("state/goals", GetAttributeService, "").attributes), 2)
        self.assertTrue(self.update([Update.REMOVE_GOAL], [more]))
        self.assertFalse(self.update([Update.ADD_GOAL], [fact("checked", "nowhere")]))

    def test_problem_that_cannot_be_written(self):
        answer = call(
            "problem_generation_server_params",
            ProblemService,
            "/proc/no/problem.pddl",
            True,
            base="rosplan_problem_interface",
        )
        self.assertFalse(answer.problem_generated)
        self.assertIn("/proc/no/problem.pddl cannot be written", answer.problem_string)

    def test_metric(self):
        metric = Item(
            knowledge_type=Item.EXPRESSION,
            optimization="minimize",
            expr=ExprComposite([ExprBase(expr_type=ExprBase.SPECIAL, special_type=ExprBase.TOTAL_TIME)]),
        )
        self.assertTrue(call("update", KnowledgeUpdateService, Update.REMOVE_METRIC, Item()).success)
        self.assertEqual(call("state/metric", GetMetricService).metric, Item())
        self.assertFalse(call("update", KnowledgeUpdateService, Update.ADD_METRIC, Item()).success)
        self.assertTrue(call("update", KnowledgeUpdateService, Update.ADD_METRIC, metric).success)
        self.assertEqual(call("state/metric", GetMetricService).metric, metric)

    def test_timed_knowledge_fires(self):
        changes = Received(f"{KB}/changes", KnowledgeChanges)
        self.addCleanup(changes.close)
        later = rospy.get_time() + 1000.0
        items = [fact("checked", "main_door", at=later), fact("checked", "bathroom", at=later)]
        self.assertTrue(self.update([0, 0], items))
        self.assertEqual(self.propositions("checked"), [])
        waiting = call("state/timed_knowledge", GetAttributeService, "checked").attributes
        self.assertEqual([item.values[0].value for item in waiting], ["main_door", "bathroom"])
        soon = rospy.get_time() + 0.5
        self.assertTrue(self.update([0], [fact("checked", "kitchen", at=soon)]))
        fired = changes.wait(lambda change: any(i.values[0].value == "kitchen" for i in change.added))
        self.assertGreaterEqual(fired.header.stamp.to_sec(), soon)
        self.assertEqual(self.propositions("checked"), [("checked", ["kitchen"], False)])
        self.assertTrue(self.update([Update.REMOVE_KNOWLEDGE] * 2, waiting))
        self.assertEqual(call("state/timed_knowledge", GetAttributeService, "").attributes, [])

    def test_changes_and_status_name_the_caller(self):
        status = Received(f"{KB}/status/update", StatusUpdate)
        changes = Received(f"{KB}/changes", KnowledgeChanges)
        self.addCleanup(status.close)
        self.addCleanup(changes.close)
        self.assertTrue(self.update([0, 1], [fact("checked", "kitchen"), fact("checked", "bathroom")]))
        change = changes.wait(lambda message: message.added)
        self.assertEqual(change.client, rospy.get_name())
        self.assertEqual(change.goals_added[0].values[0].value, "bathroom")
        self.assertEqual(status.wait(lambda message: True).last_update_client, rospy.get_name())
        call("update", KnowledgeUpdateService, 0, fact("checked", "bathroom"))
        changes.wait(lambda message: message.version == change.version + 1)
        self.assertEqual(len(status.messages), 1)

    def test_sensed_predicates(self):
        details = ("domain/predicate_details", GetDomainPredicateDetailsService, "checked")
        self.assertFalse(call(*details).is_sensed)
        self.assertTrue(call("update_sensed_predicates", SetNamedBool, "checked", True).success)
        self.assertTrue(call(*details).is_sensed)
        self.assertTrue(call("update_sensed_predicates", SetNamedBool, "checked", False).success)
        self.assertFalse(call("update_sensed_predicates", SetNamedBool, "nothing", True).success)

    def test_effects_in_one_transaction(self):
        def apply(phase, token="one", to="kitchen"):
            parameters = [KeyValue("from", "anywhere"), KeyValue("to", to)]
            request = ApplyEffectsRequest(
                operator_name="navigate", parameters=parameters, phase=phase, token=token
            )
            return call("apply_effects", ApplyEffects, request)

        self.assertTrue(apply(ApplyEffectsRequest.START).success)
        self.assertEqual(self.propositions("robot_at"), [])
        self.assertTrue(apply(ApplyEffectsRequest.ROLLBACK).success)
        self.assertEqual(self.propositions("robot_at"), [("robot_at", ["anywhere"], False)])
        refused = apply(ApplyEffectsRequest.START, "two", to="moon")
        self.assertEqual((refused.success, "moon" in refused.message), (False, True))
        self.assertTrue(apply(ApplyEffectsRequest.START, "three").success)
        self.assertTrue(apply(ApplyEffectsRequest.END, "three").success)
        self.assertEqual(self.propositions("robot_at"), [("robot_at", ["kitchen"], False)])
        self.update([2, 0], [fact("robot_at", ""), fact("robot_at", "anywhere")])

    def test_clients_at_once(self):
        results = []

        def client(number):
            update = rospy.ServiceProxy(f"{KB}/update", KnowledgeUpdateService, persistent=True)
            for _ in range(50):
                results.append(update(Update.ADD_KNOWLEDGE, instance("poi", f"spot{number}")).success)
                results.append(update(Update.REMOVE_KNOWLEDGE, instance("poi", f"spot{number}")).success)
            update.close()

        threads = [threading.Thread(target=client, args=(number,)) for number in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(results, [True] * 800)
        self.assertEqual(len(call("state/instances", GetInstanceService, "poi", False, False).instances), 4)
