# SPDX-License-Identifier: Apache-2.0
"""The text of systemd units: one that keeps a ROS command alive in a sourced workspace."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Sequence

HEAD = "# Written by rosrun merlin unit"


@dataclass(frozen=True)
class Account:
    """Where and for whom services run.

    :ivar user: that they run as.
    :ivar folder: from which relative paths count.
    :ivar setup: the script of the workspace.
    :ivar environment: variables, name → text.
    """

    user: str
    folder: Path
    setup: Path
    environment: Dict[str, str]


def unit(
    account: Account,
    description: str,
    command: Sequence[str],
    starts: Sequence[str] = (),
    keep: bool = False,
    namespace: str = "",
) -> str:
    """The text of a service.

    :param command: the words of a command of ROS, which ends with SIGINT.
    :param starts: services that are started before it and ended after it; their death is not its own.
    :param keep: start it again however often it dies, and let the kernel spare it when memory is short;
        otherwise not more than 5 times within 300 s.
    :param namespace: in which its nodes are.
    """
    before = [f"{name}.service" for name in starts]
    environment = {**account.environment, **({"ROS_NAMESPACE": namespace} if namespace else {})}
    script = f". {shlex.quote(str(account.setup))} && exec {shlex.join(command)}"
    lines = [
        HEAD,
        "[Unit]",
        f"Description={_literal(description)}",
        f"After={' '.join(['network.target', *before])}",
        *([f"Wants={' '.join(before)}"] if before else ()),
        f"StartLimitIntervalSec={0 if keep else 300}",
        *([] if keep else ["StartLimitBurst=5"]),
        "",
        "[Service]",
        f"User={account.user}",
        "SupplementaryGroups=audio",
        f"WorkingDirectory={_literal(str(account.folder))}",
        *(f"Environment={_quoted(f'{name}={text}', '')}" for name, text in sorted(environment.items())),
        f"ExecStart=/bin/bash -c {_quoted(script, '$')}",
        "Restart=always",
        "RestartSec=1",
        "# roslaunch gives its nodes 15 s.",
        "KillSignal=SIGINT",
        "KillMode=mixed",
        "TimeoutStopSec=25",
        *(["OOMScoreAdjust=-900"] if keep else ()),
        "",
        "[Install]",
        "WantedBy=multi-user.target",
    ]
    return "\n".join(lines) + "\n"


def _literal(text: str) -> str:
    """Text without the meaning that % has for systemd."""
    return text.replace("%", "%%")


def _quoted(text: str, doubled: str) -> str:
    """Text as one word of systemd.

    :param doubled: characters with a meaning of their own beside %.
    """
    text = _literal(text).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    for character in doubled:
        text = text.replace(character, 2 * character)
    return f'"{text}"'
