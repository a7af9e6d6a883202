# SPDX-License-Identifier: Apache-2.0
"""What the check of an application sees of machines that are made of SMACH's own containers."""

import smach
from merlin_actions.machine_survey import survey
from merlin_actions.merlin_action_sm import MerlinActionSM
from merlin_sm.states.merlin_state import ABORTED, PREEMPTED, SUCCEEDED

OUTCOMES = [SUCCEEDED, ABORTED, PREEMPTED]


class Trim(MerlinActionSM):
    """Drives in a Concurrence, and cuts each stem in an Iterator."""

    parameters = ["bed"]
    tool = "knife"

    def build(self) -> None:
        both = smach.Concurrence(OUTCOMES, ABORTED, input_keys=["bed"])
        with both:
            smach.Concurrence.add("DRIVE", self.state("navigation"), remapping={"target": "bed"})
        self.add("BOTH", both, {SUCCEEDED: "EACH"})
        each = smach.Iterator(
            OUTCOMES, ["bed"], [], it=range(3), it_label="stem", exhausted_outcome=SUCCEEDED
        )
        with each:
            cut = smach.StateMachine([*OUTCOMES, "next"], input_keys=["bed", "stem"])
            with cut:
                keys = ["place", "stem", self.tool]
                state = self.state("function", lambda userdata: None, keys)
                names, sharp = {"place": "bed"}, {"knife": "sharp"}
                smach.StateMachine.add("CUT", state, {SUCCEEDED: "next"}, remapping=names, constants=sharp)
            smach.Iterator.set_contained_state("ONE", cut, loop_outcomes=["next"])
        self.add("EACH", each)


class TrimWithWhat(Trim):
    """Reads what neither of them sets."""

    tool = "scissors"


def test_remappings_items_and_constants_of_smach_containers_are_known() -> None:
    needs = survey(Trim())
    assert needs.unset == ()
    assert needs.targets == ("bed",)


def test_what_nothing_sets_in_them_is_named() -> None:
    (unset,) = survey(TrimWithWhat()).unset
    assert unset.startswith("state EACH/ONE/CUT reads userdata 'scissors', which nothing sets")
