# SPDX-License-Identifier: Apache-2.0
"""Shows a machine to smach_viewer under a path that is unique on the master."""

import rospy

import smach
import smach_ros


def machine_path(name: str) -> str:
    """The root path of a machine, as viewers key it: ``/NAME``, in a namespace ``/<ns>_NAME``."""
    namespace = rospy.get_namespace().strip("/").replace("/", "_")
    return f"/{namespace}_{name}" if namespace else f"/{name}"


def start_introspection(name: str, machine: smach.State) -> smach_ros.IntrospectionServer:
    """Starts the introspection of a machine.

    :param name: in capitals by convention; lower-cased it names the topics, relative to the namespace.
    """
    server = smach_ros.IntrospectionServer(name.lower(), machine, machine_path(name))
    server.start()
    return server
