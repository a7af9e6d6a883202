# SPDX-License-Identifier: Apache-2.0
"""The action of the guide."""

from std_srvs.srv import Trigger

from merlin_actions.merlin_action_sm import MerlinActionSM

ANSWER = "#JSGF V1.0; grammar answer; public <answer> = <yes> | no; <yes> = yes [please];"


class Show(MerlinActionSM):
    """Shows a picture."""

    parameters = ["o", "p"]
    if_interrupted = ["(quiet)"]

    def build(self):
        """LIGHT → LOOK → ASK → NOTE → TELL → KNOW → HOME."""
        self.add("LIGHT", self.state("service", "light", Trigger), {"succeeded": "LOOK"})
        self.add("LOOK", self.state("recognize", ["person"]), {"succeeded": "ASK"})
        ask = self.state("ask", "May I show you {o}?", ANSWER)
        self.add("ASK", ask, {"succeeded": "NOTE", "misunderstood": "aborted"})
        self.add("NOTE", self.state("function", self.note, ["heard", "o"], ["word"]), {"succeeded": "TELL"})
        self.add("TELL", self.state("speak", "{word}, this is {o}."), {"succeeded": "KNOW"})
        self.add("KNOW", self.state("knowledge", add=["(hangs_in {o} {p})"]), {"succeeded": "HOME"})
        self.add("HOME", self.state("navigation", "hall"))

    def note(self, userdata):
        """Remembers what was answered."""
        self.change_facts(add=["(quiet)"])
        userdata.word = "Well" if userdata.heard == "no" else f"Here is {userdata.o}"


class Again(Show):
    """Runs the same operator."""

    operator = "show"
