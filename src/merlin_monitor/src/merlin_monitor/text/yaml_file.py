# SPDX-License-Identifier: Apache-2.0
"""A file of YAML that a person has written."""

from pathlib import Path
from typing import Any, Optional

import yaml


class YamlFileError(ValueError):
    """The file cannot be used; the text names it and says why."""


def read_yaml(path: Path, what: str, text: Optional[str] = None) -> Any:
    """What a file has.

    :param what: it is, for the error.
    :param text: that it had; None: it is read now.
    :raises YamlFileError: when it cannot be read, or is not YAML.
    """
    try:
        return yaml.safe_load(path.read_text(encoding="utf-8") if text is None else text)
    except (OSError, UnicodeDecodeError) as error:
        raise YamlFileError(f"{what} {path} cannot be read: {error}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # 2020-13-45 is a date for YAML
        raise YamlFileError(f"{what} {path} is not YAML: {' '.join(str(error).split())}") from error
