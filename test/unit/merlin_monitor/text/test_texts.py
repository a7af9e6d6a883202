# SPDX-License-Identifier: Apache-2.0
"""Texts are data: every text of the page and of the monitor's sentences has its German one."""

import json
import re
from typing import Set

import pytest
from served import WEB, Served
from shown_page import Visit, chromium, fill, show_panels

from merlin_monitor.panel_board import own_panels
from merlin_monitor.panels import knowledge
from merlin_monitor.state import guard_section, history_events, map_section, plan_section
from merlin_monitor.state.health_section import LEVELS
from merlin_monitor.text import request_words
from merlin_monitor.text.phrase import action_in_words, in_english, say
from merlin_monitor.text.sentences import LANGUAGES, read_sentences
from merlin_monitor.text.wording import Wording
from merlin_sm import autonomy

pytestmark = pytest.mark.processes

#: What nodes and people say stays as it is.
NAMES = ("Do you need anything?", "a coffee please", "ask in the kitchen", "travel time of", "in service")
ENGLISH = (
    r"(?i)\b(?:the|and|of|with|after|asked|is|are|step|steps|running|succeeded|failed|checked|added)\b.*"
)
PDDL = r"\((?:navigate|ask|checked|robot_at|travel_time|in_service)\b.*"
SOURCE = WEB.parent / "src"
HOME = WEB.parents[2] / "pddl" / "home"
#: The domain of the home, as the section of the knowledge has it.
DOMAIN = {
    "name": "home",
    "types": {"poi": "place", "place": ""},
    "predicates": {"robot_at": [["p", "place"]], "checked": [["p", "poi"]], "in_service": []},
    "functions": {"travel_time": [["from", "place"], ["to", "poi"]]},
    "operators": {"navigate": [["from", "place"], ["to", "poi"]], "ask": [["p", "poi"]]},
    "adds": {},
}
TEXT = r'"((?:[^"\\]|\\.)*)"'


def _texts() -> Set[str]:
    found: Set[str] = set()
    for script in WEB.rglob("*.js"):
        found |= set(re.findall(rf"\bt\({TEXT}", script.read_text()))
    page = (WEB / "index.html").read_text()
    found |= set(re.findall(r"data-t(?: [^>]*)?>([^<]+)<", page))
    for module in SOURCE.rglob("*.py"):
        if module.name == "userdata_text.py":
            continue  # its say() is another
        found |= set(re.findall(rf"(?<![.\w])say\(\s*{TEXT}", module.read_text()))
    found |= {panel.title for panel in own_panels() if panel.title}
    for words in (
        request_words.OUTCOMES,
        request_words.EXECUTOR_STATES,
        request_words.MISSION_STATES,
        plan_section.ENDED,
        plan_section._PLANNER,
    ):
        found |= set(words)
    found |= {
        *history_events.KINDS,
        *LEVELS,
        *request_words.STAGES.values(),
        *request_words.ENDS.values(),
        request_words.PAUSED,
        request_words.HELD_BEFORE,
        guard_section.SILENT_REASON,
        knowledge.FOLLOWS,
        knowledge.READS,
        knowledge.GONE,
    }
    found |= {*autonomy.LEVELS, map_section.STANDS, map_section.STANDS_GOAL, map_section.STANDS_WAY}
    return found


def test_every_text_has_its_translation_with_the_same_blanks() -> None:
    table = json.loads((WEB / "texts.de.json").read_text(encoding="utf-8"))
    missing = sorted(text for text in _texts() if text not in table)
    assert missing == [], f"texts.de.json lacks {len(missing)} texts"
    for text, german in table.items():
        assert set(re.findall(r"\{\w+\}", german)) == set(re.findall(r"\{\w+\}", text)), text
    tables = re.search(r"TABLES = \[(.*?)\]", (WEB / "texts.js").read_text())
    assert tables and {"en", *re.findall(r'"(\w+)"', tables[1])} == set(LANGUAGES)


def test_every_event_is_reported_as_data() -> None:
    plain = [
        module.name
        for module in SOURCE.rglob("*.py")
        if re.search(r"(?<![.\w])Event\(", module.read_text()) and module.name != "history_events.py"
    ]
    assert plain == [], "report them as phrases: sentence(…)"


def test_the_page_speaks_the_language_that_is_asked_for(served: Served) -> None:
    served.state.wording.sentences = read_sentences(HOME / "sentences.yaml")
    fill(served)
    with chromium() as browser:
        for query, locale in (("?lang=de", "en-US"), ("", "de-DE")):
            visit = Visit(browser, served.url + query, locale=locale)
            visit.wait_text("#now-doing", "fragt am Ort Küche")
            visit.wait_text("#now-because", "für „am Ort Küche fragen“, verlangt von Round")
            visit.wait_text("#glance-next", "fährt zum Ort Bad")
            visit.wait_text("#health-well summary", "12 sind in Ordnung")
            visit.wait_text("#stop", "Anhalten und festhalten")
            visit.wait_text("#history-list", "sagte „Do you need anything?“")
            visit.wait_text(
                "#history-list", "Plan mit 6 Schritten, zuerst fährt zum Ort Küche, fragt am Ort Küche und"
            )
            visit.wait_text("#history-list", "fährt zum Ort Küche: gelungen nach 12.0 s")
            visit.wait_text("#now-chain", "Round, Aufgabe 3 von 6")
            visit.wait_text("#plan-graph .node text", "fährt zum Ort Bad")
            visit.wait_text("#knowledge-list .fact", "ist am Ort Küche")
            visit.page.click("#health-well > summary")
            for _ in range(2):
                visit.page.locator("#history-kinds [aria-pressed=false]").first.click()
            visit.page.evaluate("document.getElementById('machines').hidden = true")  # names only
            shown = visit.page.evaluate("document.body.innerText")
            for name in (*NAMES, *re.findall(r"\w+: state", shown)):
                shown = shown.replace(name, "")
            assert re.findall(ENGLISH, shown) == []
            assert re.findall(PDDL, shown) == []
            visit.wait_text("#history-kinds", "Sprache")
            assert visit.page.evaluate("document.documentElement.lang") == "de"
            assert visit.complaints == []
            visit.close()
        visit = Visit(browser, f"{served.url}?lang=en", locale="de-DE")
        visit.wait_text("#now-doing", "asks in the kitchen")
        visit.wait_text("#knowledge-list .fact", "is at kitchen")
        visit.close()


VALUES = ["(travel_time main_door kitchen)", "(battery)", "(free-space r2)"]
GOALS = [
    ("(checked kitchen)", "kitchen checked"),
    ("(robot_at main_door)", "robot at main door"),
    ("(wants ann black_coffee)", "ann wants black coffee"),
    ("(and (checked kitchen) (not (in_service)))", "kitchen checked and not in service"),
    ("(>= (battery r2) 20)", "r2 battery ≥ 20"),
    ("(forall (?t) (served ?t))", "forall ?t ?t served"),
    ("(wants ann <b>'ale'</b>)", "(wants ann <b>'ale'</b>)"),
    ("(checked", "(checked"),
    ("", ""),
    ("(" * 40, "(" * 40),
]


#: Goals as they are told with the sentences of the home, and as facts.
REPORTED = [
    ("(checked kitchen)", "ask in the kitchen", "kitchen: was asked there"),
    ("(not (checked Kitchen))", "not kitchen: was asked there", "not kitchen: was asked there"),
    ("(and (in_service) (dusty hall_2))", "be in service and hall 2 dusty", "is in service and hall 2 dusty"),
    ("(< (travel_time kitchen main_door) 9)", *["time from kitchen to main door < 9"] * 2),
    ("(already_served t_4)", "t 4 served", "t 4 already served"),
    ("(has_been is)", *["is has been"] * 2),
    ("(is_clean kitchen)", "kitchen clean", "kitchen is clean"),
]


@pytest.mark.parametrize(("goal", "words"), GOALS)
def test_goals_in_words(goal: str, words: str) -> None:
    assert in_english(Wording().goal(goal)) == words


@pytest.mark.parametrize(("goal", "wanted", "true"), REPORTED)
def test_what_is_wanted_is_not_reported_as_true(goal: str, wanted: str, true: str) -> None:
    wording = Wording(read_sentences(HOME / "sentences.yaml"))
    wording.learn(DOMAIN)
    assert [in_english(wording.goal(goal)), in_english(wording.fact(goal))] == [wanted, true]


def test_the_page_makes_the_same_words_of_goals_and_values(served: Served) -> None:
    show_panels(served)
    wording = Wording(read_sentences(HOME / "sentences.yaml"))
    wording.learn(DOMAIN)
    reported = [goal for goal, _, _ in REPORTED]
    with chromium() as browser:
        visit = Visit(browser, served.url)
        made = visit.page.evaluate(
            """async ([goals, values, told, words]) => {
              const { factWords, valueWords } = await import("/pddl_words.js");
              const both = (each) => [factWords(each, words, true), factWords(each, words)];
              return [goals.map((each) => factWords(each)), ...[{}, words].map((known) =>
                values.map((each) => valueWords(each, known))), told.map(both)];
            }""",
            [[goal for goal, _ in GOALS], VALUES, reported, wording.shown()],
        )
        visit.close()
    values = [[in_english(each.value(text)) for text in VALUES] for each in (Wording(), wording)]
    assert made == [[words for _, words in GOALS], *values, [list(both) for _, *both in REPORTED]]


def test_sentences_without_a_start_that_is_no_place_and_without_articles_of_numbers() -> None:
    places = {"kitchen", "table_4"}
    drive = [("from", "anywhere"), ("to", "kitchen")]
    assert action_in_words("navigate", drive, places) == "navigating to the kitchen"
    assert action_in_words("check_table", [("t", "table_4")], places) == "checking table at table 4"
    phrase = say("{what}, then pausing", what=[Wording().action("ask", [("p", "{x}")])])
    assert in_english(phrase) == "asking {x}, then pausing"
