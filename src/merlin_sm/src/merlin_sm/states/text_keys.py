"""The userdata that a text with ``{key}`` names. Pure."""

import re
import string
from typing import List, Optional, Sequence


def keys_of(texts: Sequence[str], keys: Optional[Sequence[str]] = None) -> List[str]:
    """The userdata keys of texts.

    :param keys: those that the author gives; None: what the texts name.
    :raises ValueError: when a text names one that is not given, or cannot be read.
    """
    named: List[str] = []
    for text in texts:
        try:
            fields = [name for _, name, _, _ in string.Formatter().parse(text) if name is not None]
        except ValueError as error:
            raise ValueError(f"the text {text!r} cannot be read: {error}; write {{{{ for a brace") from None
        for field in fields:
            key = re.split(r"[.\[]", field)[0]
            if not key:
                raise ValueError(f"the text {text!r} has braces without a name; write {{key}}")
            if keys is not None and key not in keys:
                given = ", ".join(keys) or "none"
                raise ValueError(f"the text {text!r} names {{{key}}}, which is not among its keys: {given}")
            named.append(key)
    return list(dict.fromkeys(named)) if keys is None else list(keys)
