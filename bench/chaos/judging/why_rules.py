# SPDX-License-Identifier: Apache-2.0
"""Whether an answer to "why did it fail" names what the campaign broke."""

from typing import Dict, Iterable, Tuple

from chaos.faults import SIGNAL, Fault

#: Struck → words of which an answer about it has one: its name, or what it serves, as its peers know it.
NAMES: Dict[str, Tuple[str, ...]] = {
    "merlin_executor": ("executor",),
    "planning_system": ("planning system", "planning_system", "dispatcher", "knowledge base", "/rosplan_"),
    "merlin_bridges": ("merlin_bridges", "action interface", "no interface"),
    "merlin_fsm_host": ("merlin_fsm_host", "/actions/"),
    "navigation": ("navigation", "/move_base"),
    "soundplay_node": ("soundplay_node", "/sound_play"),
    "listen": ("/listen",),
    "merlin_guard": ("guard",),
    "master": ("master",),
    "client": ("client", "chaos"),
}
#: Outcomes of a request that was not broken: it came true, or was taken back.
NOT_FAILED = ("SUCCEEDED", "ALREADY_TRUE", "CANCELLED", "no result")


def asked_about(fault: Fault, outcomes: Iterable[str]) -> bool:
    """Whether a request failed of a fault that has a name.

    :param outcomes: of the request.
    """
    return fault.kind == SIGNAL and any(outcome not in NOT_FAILED for outcome in outcomes)


def names_it(fault: Fault, sentence: str) -> bool:
    """Whether an answer names a part that was struck."""
    words = [word for target in fault.targets for word in NAMES.get(target, (target,))]
    return any(word in sentence.lower() for word in words)
