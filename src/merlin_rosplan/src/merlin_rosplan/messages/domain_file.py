"""The domain of a knowledge base in another process, from the file that its parameter names."""

import os
import threading
from typing import Any, Optional, Tuple

import rospy

from merlin_pddl.domain import Domain
from merlin_pddl.domain_reader import read_domain
from merlin_pddl.text_reader import PddlError
from merlin_ros.master.master_link import ERRORS, bounded_master, get_param


class DomainFile:
    """Reads the domain that a knowledge base of ours holds, again when the file has changed. Thread-safe.

    Only ours evaluates whole conditions for others; of the original's domain nothing is read.

    :param knowledge_base: its global name.
    """

    def __init__(self, knowledge_base: str) -> None:
        self._knowledge_base = knowledge_base
        self._lock = threading.Lock()  # guards the two fields below
        self._read: Optional[Tuple[str, int]] = None
        self._domain: Optional[Domain] = None

    def domain(self) -> Optional[Domain]:
        """The domain; None when it is not ours, or its file is not on this machine."""
        try:
            bounded_master().lookupService(f"{self._knowledge_base}/apply_effects")
            path: Any = get_param(f"{self._knowledge_base}/domain_path", None)
            path = str(path or get_param("/rosplan/domain_path", ""))
            key = (path, os.stat(path).st_mtime_ns)
        except ERRORS:
            return None
        with self._lock:
            if key != self._read:
                try:
                    self._domain = read_domain(path)
                except PddlError as error:
                    self._domain = None
                    rospy.logwarn(f"{path} has changed and cannot be used: {error}")
                self._read = key
            return self._domain
