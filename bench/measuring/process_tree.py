# SPDX-License-Identifier: Apache-2.0
"""Memory and processor time of a process and all that it has started, by executable."""

import os
from pathlib import Path
from typing import Callable, Dict, Iterable, List

TICK = 1.0 / os.sysconf("SC_CLK_TCK")


def descendants(pid: int) -> List[int]:
    """A process and all it has started."""
    parents: Dict[int, List[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = _stat(int(path.parent.name))
        except OSError:  # it has ended
            continue
        parents.setdefault(int(fields[1]), []).append(int(path.parent.name))
    found = [pid]
    for known in found:
        found.extend(parents.get(known, ()))
    return found


def name(pid: int) -> str:
    """The executable of a process, without its interpreter and its folder.

    :raises OSError: when it has ended.
    """
    words = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
    scripts = [word for word in words if word and "python" not in word and not word.startswith("-")]
    return Path(scripts[0]).name if scripts else words[0]


def memory(pids: Iterable[int]) -> Dict[str, float]:
    """MB by executable: the own pages, and the share of those in common with others (PSS)."""
    return _by_name(pids, _pss)


def processor(pids: Iterable[int]) -> Dict[str, float]:
    """Processor time by executable, s: of these processes, and of their children that have ended."""
    return _by_name(pids, lambda pid: sum(map(int, _stat(pid)[11:15])) * TICK)


def _by_name(pids: Iterable[int], of: Callable[[int], float]) -> Dict[str, float]:
    found: Dict[str, float] = {}
    for pid in pids:
        try:
            key, value = name(pid), of(pid)
        except OSError:  # it has ended
            continue
        found[key] = found.get(key, 0.0) + value
    return found


def _stat(pid: int) -> List[str]:
    """The fields of its stat file after the name: state, parent, …"""
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()


def _pss(pid: int) -> float:
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return int(line.split()[1]) / 1024.0
    return 0.0
