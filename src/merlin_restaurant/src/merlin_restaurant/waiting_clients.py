# SPDX-License-Identifier: Apache-2.0
"""What is known of clients at the entrance: facts (waiting ?c)."""

from merlin_sm.rosplan_assistant import MerlinROSPlanAssistant


def add_client(robot: MerlinROSPlanAssistant) -> str:
    """Notes a further client who waits; returns its name."""
    client = f"client_{len(robot.objects('client')) + 1}"
    robot.add_objects("client", client)
    robot.add_facts(f"(waiting {client})")
    return client


def note_clients(robot: MerlinROSPlanAssistant, there: int) -> None:
    """Notes each waiting client: several robots lead them by one plan, one after the other.

    :param there: how many were seen.
    """
    for _ in range(there - len(robot.facts("waiting"))):
        add_client(robot)
