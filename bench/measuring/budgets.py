# SPDX-License-Identifier: Apache-2.0
"""What each figure may be at the most: a part of its name, and median and p99 (or one number)."""

from typing import Dict

#: Beginning of a figure's name → budget; the longest beginning counts.
BUDGETS: Dict[str, str] = {
    "cancel_memory_growth_mb": "1",
    "cancel_to_idle_ms": "15, p99 40",
    "cancel_to_stop_ms": "4, p99 10",
    "dispatchers esterel parse_ms": "5",
    "explain_ms": "50",
    "explain_planned_ms": "1000",
    "fact_to_decision_ms": "50",
    "goal_to_dispatch_ms": "25, p99 60",
    "guard_latency_ms": "2",
    "history_jump_ms": "200",
    "home_first_motion_s": "5",
    "home_memory_mb all": "600",
    "kb_load_10000_s": "1",
    "kb_query_ms": "1",
    "kb_restart_100000_s": "2",
    "kb_update_ms": "1",
    "monitor_change_to_visible_ms": "p95 70",
    "monitor_clients_percent_of_a_core 200": "10",
    "node_start_loaded_s": "1",
    "node_start_s": "0.15",
    "node_start_s planning_system, all services": "0.3",
    "parse_ms": "1.7",
    "plan_external_ms": "plan_external_alone_ms + 20",
    "plan_ms": "30",
    "preempt_to_urgent_ms": "45, p99 80",
    "problem_ms": "5",
    "questions cancel_to_stop_ms": "4, p99 10",
    "questions goal_to_dispatch_ms": "25, p99 60",
    "robots_dispatch cancel_to_all_stopped_ms": "p99 50",
    "robots_dispatch succeeded_to_dispatch_ms": "0.8",
    "smach_preempt_leaf_ms": "1",
    "smach_transition_introspection_us": "200",
    "smach_transition_us": "20",
    "stress_cancel_memory_growth_mb": "1 in 10 000 cancels",
    "stress_cancel_to_idle_ms": "15, p99 40",
    "stress_cancel_to_stop_ms": "4, p99 10",
    "stress_goal_to_dispatch_ms": "25, p99 60",
    "stress_preempt_to_urgent_ms": "45, p99 80",
    "succeeded_to_dispatch_ms": "0.8",
    "together cancel_to_idle_ms": "15, p99 40",
    "together cancel_to_stop_ms": "4, p99 10",
    "together cancelled_drives join": "0",
    "together join_20th_ms": "300",
    "together preempt_to_urgent_ms": "45, p99 80",
}


def budget(name: str) -> str:
    """The budget of a figure; empty when it has none.

    :param name: with the names of what it is nested in, joined by blanks.
    """
    fitting = [key for key in BUDGETS if name == key or name.startswith((f"{key} ", f"{key},"))]
    return BUDGETS[max(fitting, key=len)] if fitting else ""
