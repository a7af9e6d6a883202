"""The action (ask ?p): ask whether a service is needed."""

from merlin_actions.merlin_action_sm import MerlinActionSM

QUESTION = "Hello. I came to see if a service is needed here. Do you need something from me?"
"""The paper's question; always the same, so that its length (about 5 s) adds no spread to the results."""


class Ask(MerlinActionSM):
    """Asks the person at a point of interest, out loud."""

    parameters = ["p"]

    def build(self) -> None:
        """One state: the question."""
        self.add("SPEAK", self.state("speak", text=QUESTION))
