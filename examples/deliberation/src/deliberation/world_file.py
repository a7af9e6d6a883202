# SPDX-License-Identifier: Apache-2.0
"""World files of pyrobosim: read, put together from a base, and seeded. Without ROS and without pyrobosim."""

import copy
from pathlib import Path
from typing import Any, Dict

import yaml

from deliberation.house import ACTIONS


class WorldError(Exception):
    """A world, or pyrobosim itself, cannot be used; the text says why, for the user."""


def read_world(file: Path) -> Dict[str, Any]:
    """The world of a file.

    Beside pyrobosim's own keys a file may have `base`, a file whose keys it replaces or adds to; `closed`,
    the names of locations and hallways that are closed at first; `robot`, keys of the first robot.

    :raises WorldError: when it cannot be read or is no world.
    """
    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise WorldError(
            f"there is no world {file}: {error.strerror}; give another one, world:=FILE"
        ) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise WorldError(f"the world {file} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(data, dict):
        raise WorldError(f"the world {file} is no mapping of rooms, locations, objects and robots")
    base = data.pop("base", None)
    if base is not None:
        data = {**read_world(file.parent / str(base)), **data}
    robots = data.get("robots")
    if not isinstance(robots, list) or not robots or not isinstance(robots[0], dict):
        raise WorldError(f"the world {file} has no robot; add one to its list of robots")
    robots[0].update(data.pop("robot", {}))
    for name in data.pop("closed", ()):
        places = [*data.get("hallways", ()), *data.get("locations", ())]
        found = [place for place in places if place.get("name") == name]
        if not found:
            raise WorldError(f"the world {file} closes {name!r}, which is none of its locations and hallways")
        found[0]["is_open"] = False
    return data


def seeded(world: Dict[str, Any], seed: int, rtf: float) -> Dict[str, Any]:
    """The world with one sequence of dice for each action, and delays for the real-time factor.

    :param seed: of the dice.
    :param rtf: simulated seconds per second.
    """
    made = copy.deepcopy(world)
    options = made["robots"][0].setdefault("action_execution_options", {})
    for number, action in enumerate(ACTIONS):
        of_action = options.setdefault(action, {})
        of_action["rng_seed"] = 100 * seed + number
        of_action["delay"] = float(of_action.get("delay", 0.0)) / rtf
    return made
