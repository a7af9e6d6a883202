# SPDX-License-Identifier: Apache-2.0
"""What the machine takes from the system is counted, and what others wait is not."""

from pathlib import Path

from chaos.under_test import processes
from chaos.under_test.pressure import Waiting

RUN = "chaos1"


class Machine:
    """A /proc of our own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.steal(0)

    def steal(self, ticks: int) -> None:
        (self.folder / "stat").write_text(f"cpu 1 2 3 4 5 6 7 {ticks} 0 0\ncpu0 1 2 3 4 5 6 7 0 0 0\n")

    def thread(self, pid: int, thread: int, waited: float, run: str = RUN) -> None:
        folder = self.folder / str(pid) / "task" / str(thread)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "schedstat").write_text(f"1000 {round(waited * 1e9)} 7\n")
        (self.folder / str(pid) / "environ").write_text(f"A=b\0{processes.MARK}={run}\0")


def test_waits_of_all_threads_of_the_run_add_up(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    machine.thread(10, 10, 5.0)
    machine.thread(20, 20, 1.0, run="chaos2")
    waiting = Waiting(RUN, tmp_path)
    machine.thread(10, 10, 5.25)
    machine.thread(10, 11, 0.5)
    machine.thread(20, 20, 9.0, run="chaos2")
    assert waiting.since_last() == 0.75
    assert waiting.since_last() == 0.0


def test_a_process_counts_from_its_own_program_on(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    waiting = Waiting(RUN, tmp_path)
    machine.thread(10, 10, 0.25, run="")  # forked, and not yet the node
    assert waiting.since_last() == 0.0
    machine.thread(10, 10, 0.5)
    assert waiting.since_last() == 0.5


def test_stolen_time_counts(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    waiting = Waiting(RUN, tmp_path)
    machine.steal(50)
    assert waiting.since_last() > 0.0
