# SPDX-License-Identifier: Apache-2.0
"""How long one that leaves a run waits for a plan for the others."""

import pytest
from fakes.revision_bench import LONG, Bench, Robot, end

from merlin_executor.node import plan_revision
from merlin_sm.states import planning


def test_the_limit_of_a_leave_counts_from_its_cancel(
    bench: Bench, robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, limits, call_later = [0.0], [], plan_revision.call_later
    monkeypatch.setattr(plan_revision, "monotonic", lambda: now[0])
    for module, name in ((planning, "CALL_GRACE"), (plan_revision, "JOIN_LIMIT")):
        monkeypatch.setattr(module, name, 10 * LONG)
    first = bench.driving("(checked kitchen)")
    second = bench.send("(checked bath)")
    bench.members(first, second)
    robot.hanging = "generate_problem"
    third = bench.send("(checked attic)")
    assert robot.hangs.wait(LONG)
    monkeypatch.setattr(plan_revision, "call_later", lambda s, call: limits.append(s) or call_later(s, call))
    bench.cancel(second)
    now[0] = 0.75 * LONG  # before the look for a plan with the newcomer has ended
    robot.answer()
    assert end(second)[1] == "CANCELLED"
    assert 0.25 * LONG in limits
    bench.carry_on(first, third)
