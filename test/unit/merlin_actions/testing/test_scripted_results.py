# SPDX-License-Identifier: Apache-2.0
"""What a test writes down is what a simulated server answers; what does not fit is refused."""

import pytest
from merlin_msgs.msg import ListenResult, RecognizeResult

from merlin_actions.testing.result_script import ScriptedResults
from merlin_sm.states.recognition import recognized


def test_answers_come_one_after_the_other_and_the_last_stays():
    script = ScriptedResults(ListenResult, {"answers": ["", "yes please"]})
    assert [script.result(number).text for number in range(4)] == [
        "",
        "yes please",
        "yes please",
        "yes please",
    ]


@pytest.mark.parametrize(
    ("sees", "looks"),
    [
        (["person", "cup", "person"], [["person", "cup", "person"]] * 2),
        ([["person"], []], [["person"], []]),
    ],
)
def test_what_is_seen_is_recognized(sees, looks):
    script = ScriptedResults(RecognizeResult, {"sees": sees})
    assert [[seen.name for seen in recognized(script.result(number))] for number in range(2)] == looks


def test_any_result_can_be_written_as_its_fields():
    assert ScriptedResults(ListenResult, {"results": [{"text": "no"}]}).result(0).text == "no"
    assert ScriptedResults(ListenResult, {}).result(7) == ListenResult()


@pytest.mark.parametrize(
    "script",
    [
        {"answers": []},
        {"answers": "yes"},
        {"answers": [1]},
        {"sees": ["person"]},
        {"results": [{"words": "yes"}]},
        {"results": ["yes"]},
        {"answers": ["yes"], "sees": ["cup"]},
    ],
)
def test_what_does_not_fit_is_refused(script):
    with pytest.raises(ValueError):
        ScriptedResults(ListenResult, script)
