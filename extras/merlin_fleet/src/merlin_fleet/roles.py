# SPDX-License-Identifier: Apache-2.0
"""Users and roles of a fleet in etcd: each robot writes its own keys only, each client goals and cancels.

A user's name is that of its certificate; it has no password that is known.
"""

import secrets
from typing import Any, Iterable, List, NamedTuple

from merlin_fleet.certificates import ADMINISTRATOR, CLIENT, ROBOT, user
from merlin_fleet.certified import HubError
from merlin_fleet.core import records
from merlin_fleet.core.records import Keys
from merlin_fleet.core.store import Compare, Put, Txn
from merlin_fleet.etcd_messages import READ, READ_WRITE, behind, message
from merlin_fleet.hub import EtcdHub


class Right(NamedTuple):
    """What a role may do with a key, or with all keys that begin so (those end with '/')."""

    what: int
    key: str


class Roles:
    """Sets users and roles.

    :param hub: connected with the administrator's certificate.
    :param fleet: name of the fleet.
    """

    def __init__(self, hub: EtcdHub, fleet: str) -> None:
        self._hub = hub
        self._fleet = fleet
        self._keys = Keys(fleet)

    def set(self, robots: Iterable[str], clients: Iterable[str], fleet_id: str = "") -> List[str]:
        """Gives these robots and clients their rights; returns the users. Others keep theirs: see `remove`.

        :param fleet_id: of the fleet, where the hub has none yet; empty: a new one.
        :raises HubError: when etcd does not answer, or refuses.
        """
        self._role(ADMINISTRATOR, ADMINISTRATOR, ())
        set_ = []
        for kind, names in ((ROBOT, robots), (CLIENT, clients)):
            for name in names:
                one = user(kind, name)
                role = f"merlin.{self._fleet}.{one}"
                own = self._keys.of_clients() if kind == CLIENT else self._keys.of_robot(name)
                rights = (Right(READ, self._keys.root), *(Right(READ_WRITE, key) for key in own))
                self._role(one, role, rights)
                set_.append(one)
        about = self._keys.key(records.ABOUT)
        text = records.encode_about(fleet_id or secrets.token_hex(16))
        self._hub.transact(Txn((Compare(about, 0),), (Put(about, text),)))
        self._hub.ask("Auth/AuthEnable", message("AuthEnableRequest"))
        return set_

    def fleet_id(self) -> str:
        """The id of the fleet that the hub has, after `set`.

        :raises HubError: when etcd does not answer, or refuses.
        :raises RecordError: for a fleet of another protocol.
        """
        about = self._keys.key(records.ABOUT)
        (found,) = self._hub.transact(Txn((Compare(about, 0),), reads=(about,))).items
        return records.decode_about(found.value)

    def remove(self, name: str) -> None:
        """Takes all rights from a user: its certificate is no longer of use.

        :raises HubError: when the user does not exist, or etcd does not answer or refuses.
        """
        self._ask("UserDelete", name=name)

    def _role(self, name: str, role: str, rights: Iterable[Right]) -> None:
        """Gives a user these rights where it lacks them: each change has etcd compute those of all users."""
        known = self._ask("RoleGet", "role name not found", role=role)
        if known is None:
            self._ask("RoleAdd", "role name already exists", name=role)
        has = [(each.permType, each.key, each.range_end) for each in known.perm] if known else []
        for right in rights:
            key = right.key.encode()
            end = behind(key) if right.key.endswith("/") else b""
            if (right.what, key, end) not in has:
                permission = message("Permission", permType=right.what, key=key, range_end=end)
                self._ask("RoleGrantPermission", name=role, perm=permission)
        one = self._ask("UserGet", "user name not found", name=name)
        if one is None:
            self._ask("UserAdd", "user name already exists", name=name, password=secrets.token_hex(32))
        if one is None or role not in one.roles:
            self._ask("UserGrantRole", user=name, role=role)

    def _ask(self, method: str, allowed: str = "", /, **fields: Any) -> Any:
        """The answer; None: it is the error that is allowed."""
        try:
            return self._hub.ask(f"Auth/{method}", message(f"Auth{method}Request", **fields))
        except HubError as error:
            if not allowed or allowed not in str(error):
                raise
            return None
