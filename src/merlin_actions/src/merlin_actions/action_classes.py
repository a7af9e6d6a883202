# SPDX-License-Identifier: Apache-2.0
"""The action classes of an application, as its launch file names them."""

from typing import List, Sequence

import rospy

from merlin_actions.core.application_check import ApplicationError
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_ros.class_path import WITHOUT_BASE, cannot_be_made, load_class


def read_machines() -> List[MerlinActionSM]:
    """Makes the machines that the parameter ``~actions`` names: a list of ``package.module:Class``.

    :raises ValueError: when it is not such a list, or one of them is not a class of actions.
    """
    paths = rospy.get_param("~actions", [])
    if not isinstance(paths, list) or not paths or not all(isinstance(path, str) for path in paths):
        name = rospy.resolve_name("~actions")
        raise ValueError(f"parameter {name} has to be a list of package.module:Class")
    return make_machines(paths)


def make_machines(paths: Sequence[str]) -> List[MerlinActionSM]:
    """Makes a machine of each class.

    :param paths: ``package.module:Class`` each.
    :raises ApplicationError: names all that are not classes of actions, stand twice, or cannot be made.
    """
    machines: List[MerlinActionSM] = []
    mistakes: List[str] = []
    for position, path in enumerate(paths):
        try:
            action_class = load_class(path)
            if not issubclass(action_class, MerlinActionSM):
                raise ValueError(f"{path} is not a MerlinActionSM")
            if paths.index(path) < position:
                raise ValueError(f"{path} stands twice")
        except ValueError as error:
            mistakes.append(f"{error}; correct the launch file's 'actions'")
            continue
        try:
            machine = action_class()
            if not hasattr(machine, "userdata"):
                raise ValueError(WITHOUT_BASE)
            machines.append(machine)
        except (Exception, SystemExit) as error:  # users' code
            mistakes.append(cannot_be_made(path, error))
    if mistakes:
        raise ApplicationError(mistakes)
    return machines
