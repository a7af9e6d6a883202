# SPDX-License-Identifier: Apache-2.0
"""Which persons of the restaurant can hear and speak."""

from pathlib import Path
from typing import List

import pytest
import rospkg
from roslaunch.config import ROSLaunchConfig
from roslaunch.xmlloader import XmlLoader

from merlin_guests.schedule import NAMES

LAUNCH = Path(rospkg.RosPack().get_path("merlin")) / "launch" / "restaurant.launch"


def voices(guests: str) -> List[str]:
    config = ROSLaunchConfig()
    text = f'<launch><include file="{LAUNCH}"><arg name="guests" value="{guests}"/></include></launch>'
    XmlLoader(resolve_anon=False).load_string(text, config)
    prefix = "/person_voice/people/"
    return sorted(
        {name[len(prefix) :].partition("/")[0] for name in config.params if name.startswith(prefix)}
    )


@pytest.mark.parametrize("guests", [1, 3, len(NAMES)])
def test_guests_that_do_not_come_are_not_missed(guests: int) -> None:
    assert voices(str(guests)) == sorted(["barman", *NAMES[:guests]])


def test_a_number_that_is_none_is_named_by_the_players() -> None:
    assert voices("many") == sorted(["barman", *NAMES])
