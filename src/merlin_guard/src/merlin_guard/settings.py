# SPDX-License-Identifier: Apache-2.0
"""What can be set on the guard."""

from typing import NamedTuple


class GuardSettings(NamedTuple):
    """Limits of the guard. All times are s of wall time unless said otherwise."""

    suspend_after: float = 0.6
    """Silence of an owner after which its goals must not move the base."""
    lose_after: float = 3.0
    """Silence of an owner after which its goals are cancelled."""
    cancel_deadline: float = 0.5
    """Time within which a cancelled goal may still move the base."""
    brake_limit: float = 2.0
    """Time for which a brake holds a goal that is not cancelled meanwhile."""
    command_timeout: float = 0.3
    """Time without a command after which the base is stopped; stands still while the simulator is paused."""
    status_silence: float = 1.0
    """Silence of a motion server after which it must not move the base; stands still likewise."""
    forget_after: float = 15.0
    """Silence of a motion server after which its goals count as ended; stands still likewise."""
    no_command_after: float = 5.0
    """Time that a goal drives without a command after which the guard says so; stands still likewise."""
    no_command_limit: float = 60.0
    """Time after which the client of such a goal shall give it up; likewise."""
    no_motion_after: float = 3.0
    """Time that odometry stands still while commands pass after which the guard says so; likewise."""
    require_lease: bool = False
    """Whether a goal that no lease names is refused."""

    def check(self) -> None:
        """Checks that the limits fit together.

        :raises ValueError: when they do not, with both names.
        """
        for name, value in self._asdict().items():
            if name != "require_lease" and value <= 0.0:
                raise ValueError(f"{name} is {value:g}; it has to be more than 0")
        for shorter, longer in (
            ("suspend_after", "lose_after"),
            ("status_silence", "forget_after"),
            ("no_command_after", "no_command_limit"),
        ):
            short, long = getattr(self, shorter), getattr(self, longer)
            if short > long:
                raise ValueError(f"{shorter} ({short:g} s) is longer than {longer} ({long:g} s)")
