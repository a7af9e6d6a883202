# SPDX-License-Identifier: Apache-2.0
"""Launch files that include ROSPlan's: every argument that those have is accepted and means what it meant."""

import pytest
from rosgraph.names import resolve_name
from roslaunch.config import ROSLaunchConfig
from roslaunch.xmlloader import XmlLoader

FOLDER = "$(find rosplan_planning_system)/launch"
KNOWLEDGE, PROBLEM, PLANNER = (
    "rosplan_knowledge_base",
    "rosplan_problem_interface",
    "rosplan_planner_interface",
)
PARSING, DISPATCHER = "rosplan_parsing_interface", "rosplan_plan_dispatcher"

NAME, EXECUTABLE = "the node's name", "the node's executable"

#: file -> argument -> value -> where it shows: parameters, or the name or executable of a node.
ARGUMENTS = {
    "interfaced_planning_system.launch": {
        "domain_path": ("/d.pddl", [f"/{KNOWLEDGE}/domain_path", f"/{PLANNER}/domain_path"]),
        "problem_path": ("/p.pddl", [f"/{KNOWLEDGE}/problem_path"]),
        "autom_gen_problem_path": ("/g.pddl", [f"/{PROBLEM}/problem_path", f"/{PLANNER}/problem_path"]),
        "data_path": ("/data/", [f"/{PLANNER}/data_path"]),
        "use_problem_topic": (False, [f"/{PLANNER}/use_problem_topic"]),
        "planner_command": ("ff -o DOMAIN -f PROBLEM", [f"/{PLANNER}/planner_command"]),
        "planner_interface": ("ff_planner_interface", EXECUTABLE),
        "generated_problem_path": ("/g.pddl", [f"/{PROBLEM}/problem_path", f"/{PLANNER}/problem_path"]),
    },
    "includes/knowledge_base.launch": {
        "node_name": ("kb", NAME),
        "domain_path": ("/d.pddl", [f"/{KNOWLEDGE}/domain_path"]),
        "problem_path": ("/p.pddl", [f"/{KNOWLEDGE}/problem_path"]),
        "use_unknowns": (True, [f"/{KNOWLEDGE}/use_unknowns"]),
    },
    "includes/problem_interface.launch": {
        "node_name": ("pi", NAME),
        "knowledge_base": ("kb", [f"/{PROBLEM}/knowledge_base"]),
        "domain_path": ("/d.pddl", [f"/{PROBLEM}/domain_path"]),
        "problem_path": ("/p.pddl", [f"/{PROBLEM}/problem_path"]),
        "problem_topic": ("topic", [f"/{PROBLEM}/problem_topic"]),
        "planning_language": ("PDDL", [f"/{PROBLEM}/planning_language"]),
    },
    "includes/planner_interface.launch": {
        "node_name": ("pl", NAME),
        "use_problem_topic": (False, [f"/{PLANNER}/use_problem_topic"]),
        "problem_topic": ("/topic", [f"/{PLANNER}/problem_topic"]),
        "planner_topic": ("topic", [f"/{PLANNER}/planner_topic"]),
        "domain_path": ("/d.pddl", [f"/{PLANNER}/domain_path"]),
        "problem_path": ("/p.pddl", [f"/{PLANNER}/problem_path"]),
        "data_path": ("/data/", [f"/{PLANNER}/data_path"]),
        "planner_command": ("ff -o DOMAIN -f PROBLEM", [f"/{PLANNER}/planner_command"]),
        "planner_interface": ("ff_planner_interface", EXECUTABLE),
    },
    "includes/parsing_interface.launch": {
        "node_name": ("pa", NAME),
        "knowledge_base": ("kb", [f"/{PARSING}/knowledge_base"]),
        "epsilon_time": (0.5, [f"/{PARSING}/epsilon_time"]),
        "planner_topic": ("/topic", [f"/{PARSING}/planner_topic"]),
        "plan_topic": ("topic", [f"/{PARSING}/plan_topic"]),
    },
    "includes/dispatch_interface.launch": {
        "node_name": ("di", NAME),
        "knowledge_base": ("kb", [f"/{DISPATCHER}/knowledge_base"]),
        "plan_topic": ("/topic", [f"/{DISPATCHER}/plan_topic"]),
        "action_dispatch_topic": ("topic", [f"/{DISPATCHER}/action_dispatch_topic"]),
        "action_feedback_topic": ("topic", [f"/{DISPATCHER}/action_feedback_topic"]),
        "display_edge_type": (True, [f"/{DISPATCHER}/display_edge_type"]),
        "timeout_actions": (True, [f"/{DISPATCHER}/timeout_actions"]),
        "action_timeout_fraction": (0.5, [f"/{DISPATCHER}/action_timeout_fraction"]),
    },
    "includes/simulated_action.launch": {
        "pddl_action_name": ("undock", ["/rosplan_interface_undock/pddl_action_name"]),
        "action_duration": (2.5, ["/rosplan_interface_undock/action_duration"]),
        "action_duration_stddev": (0.5, ["/rosplan_interface_undock/action_duration_stddev"]),
        "action_probability": (0.5, ["/rosplan_interface_undock/action_probability"]),
        "knowledge_base": ("kb", ["/rosplan_interface_undock/knowledge_base"]),
        "action_dispatch_topic": ("/topic", ["/rosplan_interface_undock/action_dispatch_topic"]),
        "action_feedback_topic": ("/topic", ["/rosplan_interface_undock/action_feedback_topic"]),
    },
}
CASES = [(file, name) for file, arguments in ARGUMENTS.items() for name in arguments]


def launch(file, arguments, group=""):
    """A launch file of a user, as roslaunch reads it."""
    inner = "".join(f'<arg name="{name}" value="{value}"/>' for name, value in arguments.items())
    include = f'<include file="{FOLDER}/{file}">{inner}</include>'
    text = (
        f'<launch><group ns="{group}">{include}</group></launch>' if group else f"<launch>{include}</launch>"
    )
    config = ROSLaunchConfig()
    XmlLoader(resolve_anon=False).load_string(text, config)
    return config


@pytest.mark.parametrize("file, name", CASES)
def test_argument_is_accepted_and_reaches_its_node(file, name):
    value, shows = ARGUMENTS[file][name]
    config = launch(file, {name: str(value).lower() if isinstance(value, bool) else value})
    if shows == NAME:
        assert value in [node.name for node in config.nodes]
    elif shows == EXECUTABLE:
        assert value in [node.type for node in config.nodes]
    else:
        assert {parameter: config.params[parameter].value for parameter in shows} == dict.fromkeys(
            shows, value
        )


@pytest.mark.parametrize("file", ARGUMENTS)
def test_no_argument_is_required_and_all_together_are_accepted(file):
    assert launch(file, {}).nodes
    arguments = {name: value for name, (value, _) in ARGUMENTS[file].items()}
    assert launch(file, arguments).nodes


#: file -> argument -> another node of the planning system, or one of its topics
TOPICS = {
    "planner_interface.launch": {"problem_topic": f"{PROBLEM}/problem_instance"},
    "problem_interface.launch": {"knowledge_base": KNOWLEDGE},
    "parsing_interface.launch": {"knowledge_base": KNOWLEDGE, "planner_topic": f"{PLANNER}/planner_output"},
    "dispatch_interface.launch": {"knowledge_base": KNOWLEDGE, "plan_topic": f"{PARSING}/complete_plan"},
    "simulated_action.launch": {
        "knowledge_base": KNOWLEDGE,
        "action_dispatch_topic": f"{DISPATCHER}/action_dispatch",
        "action_feedback_topic": f"{DISPATCHER}/action_feedback",
    },
}
LINKS = [(file, name) for file, topics in TOPICS.items() for name in topics]


def name_of(config, name):
    """What the node of a launch file takes for the name in a parameter."""
    (node,) = config.nodes
    node_name = f"{node.namespace}{node.name}"
    remaps = {
        resolve_name(source, node_name): resolve_name(target, node_name) for source, target in node.remap_args
    }
    value = f"/{config.params[f'{node_name}/{name}'].value.lstrip('/')}"  # a knowledge base has no slash
    return remaps.get(value, value)


@pytest.mark.parametrize("file, name", LINKS)
@pytest.mark.parametrize("group", ["", "robot1", "fleet/robot1"])
def test_in_a_group_with_a_namespace_nodes_are_joined_to_those_of_the_group(file, name, group):
    config = launch(f"includes/{file}", {}, group)
    assert name_of(config, name) == f"/{group}/{TOPICS[file][name]}".replace("//", "/")
    assert name_of(launch(f"includes/{file}", {name: "/other/topic"}, group), name) == "/other/topic"
