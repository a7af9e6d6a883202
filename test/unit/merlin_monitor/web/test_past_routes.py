# SPDX-License-Identifier: Apache-2.0
"""What the page asks when it shows the past: strange questions are refused, and the map of then is found."""

import json

from served import Served, ask


def test_bad_questions_are_refused(served: Served) -> None:
    for path in (
        *(
            "marks",
            "marks?run=x",
            "marks?run=-1",
            f"marks?run={10**30}",
            "segment?run=1",
            "segment?run=1&wall=x",
        ),
        *("segment?run=1&wall=nan", "segment?run=1&wall=inf", "event?run=1&wall=1&id=x", "event?wall=1"),
    ):
        assert ask(served.url, f"past/{path}").status == 400, path
    assert ask(served.url, "past/segment?run=77&wall=1").status == 404
    assert ask(served.url, "past/event?run=77&wall=1&kinds=%00,'&marks=%ff").said == "null"
    assert json.loads(ask(served.url, "past/marks?run=77").said) == []
    assert ask(served.url, "map.png?version=../../etc/passwd").status == 404


def test_the_map_of_then_is_found(served: Served) -> None:
    assert served.state.history is not None
    served.state.history.add_picture("map", "abc", b"\x89PNG of then")
    answer = ask(served.url, "map.png?version=abc")
    assert answer.status == 200 and answer.content_bytes == b"\x89PNG of then"
