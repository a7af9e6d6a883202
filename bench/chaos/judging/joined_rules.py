# SPDX-License-Identifier: Apache-2.0
"""Judges requests that run together: each ends once, for a reason of its own, and with what is true."""

from typing import List

from chaos.judging import events
from chaos.judging.evidence import JOINED, REQUEST, Evidence

#: The Executor's reason where the client has cancelled a request.
BY_ITS_CLIENT = "cancelled by its client"


def each_ends_for_itself(evidence: Evidence) -> List[str]:
    """Each of the requests ends once; the cancel or the deadline of another one does not end it."""
    found = []
    for label in (REQUEST, *JOINED) if evidence.trial.joined else ():
        ends = [event for event in evidence.log if event.kind == events.ENDED and event["label"] == label]
        name = f"the {label} request" if label != REQUEST else "the first request"
        if len(ends) > 1:
            found.append(f"{name} has ended {len(ends)} times: {', '.join(each['outcome'] for each in ends)}")
        for ended in ends[:1]:
            asked, sent = evidence.first(events.CANCEL, label), evidence.first(events.SENT, label)
            before = asked is not None and asked.at <= ended.at
            for_all = evidence.trial.fault.cancels_each and evidence.zero <= ended.at
            if ended["reason"] == BY_ITS_CLIENT and not (before or for_all):
                found.append(
                    f"{name} is cancelled at {evidence.when(ended.at)}: its client has not done that"
                )
            if ended["outcome"] == "LATE" and not (sent is not None and sent.get("deadline")):
                found.append(f"{name} is late at {evidence.when(ended.at)}, and has no deadline")
    return found


def what_has_succeeded_holds(evidence: Evidence) -> List[str]:
    """The goal of a request that has joined and succeeded holds at the end."""
    found = []
    looks = [event for event in evidence.log if event.kind == events.FACTS and "said" in event.data]
    for label in JOINED:
        sent, ended = evidence.first(events.SENT, label), evidence.first(events.ENDED, label)
        if sent is None or ended is None or ended["outcome"] != "SUCCEEDED":
            continue
        after = [look for look in looks if look.at > ended.at]
        if after and not set(sent["goals"]) <= set(after[-1]["said"]):
            goal, at = ", ".join(sent["goals"]), evidence.when(after[-1].at)
            found.append(f"the {label} request has succeeded, and {goal} does not hold at {at}")
    return found
