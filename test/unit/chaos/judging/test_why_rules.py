# SPDX-License-Identifier: Apache-2.0
"""Which requests are asked about, and when an answer names what was struck."""

import pytest
from chaos.faults import all_faults
from chaos.judging.why_rules import asked_about, names_it

FAULTS = all_faults()


@pytest.mark.parametrize(
    ("fault", "sentence", "named"),
    [
        ("navigation:kill", "“robot at hall” failed: the server /move_base was not there.", True),
        ("navigation:kill", "“robot at hall” failed: the server /sound_play was not there.", False),
        ("merlin_bridges:stop", "the action interface of say is gone, silent for 17.2 s", True),
        ("planning_system:term", "service /rosplan_knowledge_base/domain/name does not answer", True),
        ("merlin_explain:kill", "the server /move_base was not there", False),
    ],
)
def test_an_answer_names_a_part_or_what_it_serves(fault: str, sentence: str, named: bool) -> None:
    assert names_it(FAULTS[fault], sentence) is named


@pytest.mark.parametrize(
    ("fault", "outcomes", "asked"),
    [
        ("navigation:kill", ["ACTION_FAILED"], True),
        ("navigation:kill", ["SUCCEEDED"], False),
        ("navigation:kill", ["CANCELLED"], False),
        ("navigation:kill", [], False),
        ("link:cut5", ["ACTION_FAILED"], False),
    ],
)
def test_only_what_failed_of_a_named_part_is_asked_about(fault: str, outcomes: list, asked: bool) -> None:
    assert asked_about(FAULTS[fault], outcomes) is asked
