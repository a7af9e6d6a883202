# SPDX-License-Identifier: Apache-2.0
"""systemd starts, restarts and ends the services that `rosrun merlin unit` writes, for an ordinary user.

It boots over this machine's own files, of which nothing is changed, and without its network.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
LONGEST = 900.0  # s for all of it, on a machine that does much else
NEEDED = ("systemd-nspawn", "unshare")

#: Starts only what is asked for: no service of this machine.
TARGET = """
[Unit]
Requires=basic.target
Wants=asked.service
"""
ASKED = """
[Unit]
After=basic.target
[Service]
Type=oneshot
TimeoutStartSec=800
ExecStart=/bin/bash /etc/systemd/system.control/asked.sh
ExecStopPost=/bin/systemctl poweroff
StandardOutput=file:/etc/systemd/system.control/said
StandardError=inherit
"""
#: What the README says, in a shell; then what becomes of services that die, and of all when they are stopped.
SCRIPT = """
here=/etc/systemd/system.control
useradd --create-home robot && cp $here/points.yaml /home/robot && cd /home/robot || exit
. "$WORKSPACE"
export ROS_HOSTNAME=localhost ROS_MASTER_URI=http://localhost:11311
runuser robot -c 'rosrun merlin unit "$LAUNCH" on:=robot world_file:=points.yaml monitor:=false' || exit
cp merlin*.service /etc/systemd/system/ && systemctl daemon-reload || exit
systemctl enable --now merlin-master merlin-guard merlin || exit

shown() { systemctl show --value --property "$1" "$2"; }
heard() { until timeout 60 rostopic echo -n 1 "$1" >/dev/null 2>&1; do sleep 0.2; done; echo "heard: $1 $2"; }
killed() {
  old=$(shown MainPID $1)
  kill -KILL $old
  until new=$(shown MainPID $1); [ $new != 0 ] && [ $new != $old ]; do sleep 0.1; done
}
heard /merlin/guard
heard /merlin/execute/status
serving=$(shown MainPID merlin)
ps -o user= -p $serving
killed merlin-guard && heard /merlin/guard again
killed merlin-master && heard /merlin/execute/status again
[ $serving != "$(shown MainPID merlin)" ] || echo "merlin has served on"
systemctl stop merlin merlin-guard merlin-master
for service in merlin merlin-guard merlin-master; do
  echo "$service: $(shown ActiveState $service), $(shown Result $service)"
done
pgrep -u robot || echo "no process is left"
"""


def missing() -> str:
    """Why systemd cannot be tried here; empty: it can."""
    lacking = [tool for tool in NEEDED if shutil.which(tool) is None]
    if lacking or os.getuid() != 0:
        return f"needs root and {', '.join(NEEDED)}: apt install systemd-container"
    if any(not folder.stat().st_mode & 1 for folder in (ROOT, *ROOT.parents)):
        return "another user cannot read this checkout"
    return ""


@pytest.mark.long
@pytest.mark.timeout(2 * LONGEST)
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_systemd_starts_restarts_and_ends_them(tmp_path: Path) -> None:
    root, units = tmp_path / "root", tmp_path / "units"
    root.mkdir()
    units.mkdir()
    script = SCRIPT.replace("$WORKSPACE", str(ROOT / "devel/setup.bash"))
    script = script.replace("$LAUNCH", str(ROOT / "launch/include/application.launch"))
    for name, text in (("asked.target", TARGET), ("asked.service", ASKED), ("asked.sh", script)):
        (units / name).write_text(text)
    shutil.copy(str(ROOT / "test/data/points_of_interest.yaml"), str(units / "points.yaml"))
    boot = [
        *("systemd-nspawn", "--quiet", "--register=no", "--keep-unit", "--private-network"),
        *("--machine", f"merlin-{os.getpid()}", "--directory", str(root), "--volatile=overlay"),
        *("--bind", f"{units}:/etc/systemd/system.control"),
        *("--boot", "systemd.unit=asked.target", "systemd.show_status=false"),
    ]
    mount = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "--propagation", "private", "sh", "-c"]
    booted = subprocess.run(
        [*mount, f'mount --bind / {root} && exec "$@"', "sh", *boot],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        stdin=subprocess.DEVNULL,
        text=True,
        timeout=LONGEST,
    )
    assert (units / "said").exists(), booted.stdout
    said = (units / "said").read_text()
    for sentence in (
        "heard: /merlin/guard \n",
        "heard: /merlin/execute/status \nrobot\n",
        "heard: /merlin/guard again\n",
        "heard: /merlin/execute/status again\nmerlin has served on\n",
        "merlin: inactive, success\nmerlin-guard: inactive, success\nmerlin-master: inactive, success\n",
        "no process is left",
    ):
        assert sentence in said, said
