# SPDX-License-Identifier: Apache-2.0
import contextlib
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys

import pytest

from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Fact, FunctionValue, Instance, StoredGoal
from merlin_pddl.problem_reader import parse_problem
from merlin_pddl.problem_writer import write_problem
from merlin_rosplan.knowledge.executions import Executions
from merlin_rosplan.knowledge.knowledge_checks import UpdateRefused
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.storage.state_file import StateFile, StateFileError

DOMAIN_TEXT = """(define (domain d) (:types place robot)
    (:predicates (at ?r - robot ?p - place) (clean ?p - place)) (:functions (battery ?r - robot))
    (:durative-action drive :parameters (?r - robot ?from ?to - place) :duration (= ?duration 1)
      :effect (and (at start (not (at ?r ?from))) (at end (at ?r ?to)))))"""
DOMAIN = parse_domain(DOMAIN_TEXT)
PROBLEM = """(define (problem p) (:domain d) (:objects a b c - place r - robot)
    (:init (at r a) (not (clean a)) (clean b) (= (battery r) 0.1) (at 100 (clean c)))
    (:goal (and (clean a) (not (at r a)) (or (clean c) (exists (?p - place) (clean ?p))) (> (battery r) 0)))
    (:metric minimize (* 2 (battery r))))"""

WRITER = """
import sys
from merlin_pddl.domain_reader import parse_domain
from merlin_pddl.knowledge import Instance
from merlin_rosplan.knowledge.knowledge_store import KnowledgeStore
from merlin_rosplan.storage.state_file import StateFile
store = KnowledgeStore(parse_domain(sys.argv[2]), journal=StateFile(sys.argv[1], parse_domain(sys.argv[2])))
number = 0
while True:
    with store.transaction() as change:
        change.add(Instance("place", f"p{number}a"))
        change.add(Instance("place", f"p{number}b"))
    print(number, flush=True)
    number += 1
"""


def open_store(path, domain=DOMAIN, **options):
    return KnowledgeStore(domain, clock=lambda: 1000, journal=StateFile(str(path), domain, **options))


def problem_text(store):
    return write_problem(store.snapshot()[1], DOMAIN)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "deep" / "state.sqlite"


def test_everything_comes_back_in_its_order(path):
    store = open_store(path)
    store.load_problem(parse_problem(PROBLEM, DOMAIN))
    with store.transaction() as change:
        change.remove(Fact("clean", ("b",)))
        change.add(Fact("clean", ("b",)))
        change.add(Fact("clean", ("a",)))  # turns round in its place
        change.add(FunctionValue("battery", ("r",), 0.2, op="increase"))
        change.note(change.state.sensed, "clean", {})
    expected, version = problem_text(store), store.version
    store.close()
    again = open_store(path)
    assert problem_text(again) == expected and again.version == version and again.sensed("clean")
    assert [fact.text() for fact in again.facts()] == ["(at r a)", "(clean a)", "(clean b)"]
    assert again.next_due() == 100_000_001_000
    with again.transaction() as change:
        change.clear()
        change.add(Instance("place", "only"))
    again.close()
    assert open_store(path).instances() == ["only"]


def test_action_that_outlives_the_knowledge_base(path):
    parameters = {"r": "r", "from": "a", "to": "b"}
    store = open_store(path)
    store.load_problem(parse_problem(PROBLEM, DOMAIN))
    with store.transaction() as change:
        Executions(change).start("run 1", "drive", parameters)
    store.close()
    again = open_store(path)
    assert again.facts("at") == []
    with again.transaction() as change:
        Executions(change).rollback("run 1", "drive")
    assert [fact.text() for fact in again.facts("at")] == ["(at r a)"]


def test_refused_transaction_leaves_no_trace_in_the_file(path):
    store = open_store(path)
    with pytest.raises(UpdateRefused), store.transaction() as change:
        change.add(Instance("place", "a"))
        change.add(Fact("clean", ("b",)))
    store.close()
    again = open_store(path)
    assert again.instances() == [] and again.version == 0


@pytest.mark.everywhere
def test_killed_process_loses_nothing_it_acknowledged(path):
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), DOMAIN_TEXT], stdout=subprocess.PIPE, text=True
    )
    seen = -1
    for line in process.stdout:
        seen = int(line)
        if seen == 200:
            os.kill(process.pid, signal.SIGKILL)
            break
    rest = process.stdout.read().split()
    process.wait()
    process.stdout.close()
    acknowledged = int(rest[-1]) if rest else seen
    names = open_store(path).instances("place")
    expected = [f"p{number}{half}" for number in range(len(names) // 2) for half in "ab"]
    assert names == expected and len(names) // 2 > acknowledged


class FullDisk:
    """A file system of two megabytes."""

    def __init__(self, folder):
        self.folder = folder
        folder.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(folder)]
        done = subprocess.run(mount, capture_output=True, text=True, check=False)
        if done.returncode:  # also root may not in a container
            pytest.skip(f"a small file system cannot be mounted: {done.stderr.splitlines()[0]}")

    def fill(self):
        with (self.folder / "ballast").open("wb", buffering=0) as ballast, contextlib.suppress(OSError):
            while True:
                ballast.write(bytes(4096))

    def make_space(self, left=0):
        """Takes away what fills it.

        :param left: bytes of it that stay.
        """
        os.truncate(self.folder / "ballast", left)


@pytest.fixture
def disk(tmp_path):
    made = FullDisk(tmp_path / "disk")
    yield made
    subprocess.run(["umount", "-l", str(made.folder)], check=True)


def drive(store, phase, token):
    with store.transaction() as change:
        getattr(Executions(change), phase)(token, "drive", **_PARAMETERS.get(phase, {}))


_BINDING = {"parameters": {"r": "r", "from": "a", "to": "b"}}
_PARAMETERS = {"start": _BINDING, "end": _BINDING}


@pytest.mark.everywhere
def test_full_disk_takes_nothing_new_but_what_runs_comes_to_its_end(disk):
    path = disk.folder / "state.sqlite"
    store = open_store(path)
    problem = parse_problem(PROBLEM, DOMAIN)
    store.load_problem(problem)
    drive(store, "start", "one")
    disk.fill()
    with pytest.raises(UpdateRefused, match="state.sqlite: database or disk is full"):
        drive(store, "start", "two")
    with pytest.raises(UpdateRefused, match="full"), store.transaction() as change:
        change.add(Fact("clean", ("a",)))
    drive(store, "rollback", "one")
    with store.transaction() as change:
        for condition in problem.goals:
            change.remove_goal(StoredGoal(condition))
    disk.make_space()
    with store.transaction() as change:
        change.add(Fact("clean", ("a",)))
    disk.fill()  # and once more
    with store.transaction() as change:
        change.remove(Fact("clean", ("a",)))
    before = problem_text(store)
    store.close()
    again = open_store(path)
    assert problem_text(again) == before
    assert [fact.text() for fact in again.facts("at")] == ["(at r a)"]
    assert again.snapshot()[1].goals == []
    again.close()


@pytest.mark.everywhere
def test_full_disk_lets_everything_be_taken_away(disk):
    path = disk.folder / "state.sqlite"
    store = open_store(path)
    store.load_problem(parse_problem(PROBLEM, DOMAIN))
    disk.fill()
    with store.transaction() as change:
        change.clear()
    store.close()
    again = open_store(path)
    assert again.instances() == [] and again.goals() == []
    again.close()


@pytest.mark.everywhere
def test_where_no_reserve_can_be_made_changes_are_taken(path):
    (path.parent / f"{path.name}.reserve").mkdir(parents=True)  # as one that belongs to another user
    store = open_store(path)
    with store.transaction() as change:
        change.add(Instance("place", "kitchen"))
    store.close()
    again = open_store(path)
    assert again.instances() == ["kitchen"]
    again.close()


@pytest.mark.everywhere
def test_nothing_begins_for_whose_end_there_is_no_space(disk):
    path = disk.folder / "state.sqlite"
    store = open_store(path)
    store.load_problem(parse_problem(PROBLEM, DOMAIN))
    drive(store, "start", "one")
    disk.fill()
    drive(store, "end", "one")  # takes the reserve
    disk.fill()
    disk.make_space(os.path.getsize(disk.folder / "ballast") - 100_000)
    with pytest.raises(UpdateRefused, match="state.sqlite: database or disk is full"):
        drive(store, "start", "two")
    disk.make_space()
    drive(store, "start", "two")
    disk.fill()
    drive(store, "rollback", "two")
    store.close()


@pytest.mark.everywhere
@pytest.mark.parametrize("removed", ["the folder", "the file"])
def test_a_file_that_was_removed_is_made_again(path, removed):
    store = open_store(path)
    with store.transaction() as change:
        change.add(Instance("place", "before"))
    if removed == "the folder":
        shutil.rmtree(path.parent)
    else:
        path.unlink()
    for name in ("after", "later"):
        with store.transaction() as change:
            change.add(Instance("place", name))
    with pytest.raises(StateFileError, match=f"process {os.getpid()} has it open"):
        open_store(path)
    store.close()
    again = open_store(path)
    assert again.instances() == ["before", "after", "later"] and again.version == 3
    again.close()


@pytest.mark.everywhere
def test_without_a_folder_to_make_the_file_again_the_store_goes_on(path):
    store = open_store(path)
    shutil.rmtree(path.parent)
    path.parent.write_text("a file is in the way")
    with store.transaction() as change:
        change.add(Instance("place", "after"))
    assert store.instances() == ["after"]
    store.close()


def test_file_of_another_domain_is_refused(path):
    open_store(path).close()
    other = parse_domain(DOMAIN_TEXT.replace("(clean ?p - place)", "(clean ?p - place) (wet)"))
    with pytest.raises(StateFileError, match="another domain or of another version"):
        open_store(path, other)
    same = parse_domain("; a comment\n" + DOMAIN_TEXT.upper())
    open_store(path, same).close()
    open_store(path, other, reset=True).close()


@pytest.mark.everywhere
def test_file_in_use_is_refused(path):
    store = open_store(path)
    with pytest.raises(StateFileError, match="another knowledge base using it"):
        open_store(path)
    store.close()


@pytest.mark.everywhere
def test_damaged_file_is_refused(path):
    path.parent.mkdir()
    path.write_text("this is not a database" * 100)
    with pytest.raises(StateFileError, match="cannot be used: file is not a database"):
        open_store(path)
    open_store(path, reset=True).close()


def test_reset_leaves_a_file_alone_that_is_open(path):
    store = open_store(path)
    with store.transaction() as change:
        change.add(Instance("place", "kept"))
    with pytest.raises(
        StateFileError, match=f"process {os.getpid()} has it open.*another knowledge base using it"
    ):
        open_store(path, reset=True)
    with store.transaction() as change:
        change.add(Instance("place", "told_later"))
    store.close()
    assert open_store(path).instances() == ["kept", "told_later"]


def test_lock_ends_with_a_killed_process(path):
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), DOMAIN_TEXT], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline()
    with pytest.raises(StateFileError, match=f"process {process.pid} has it open"):
        open_store(path)
    process.kill()
    process.wait()
    process.stdout.close()
    open_store(path).close()


def filled(path):
    store = open_store(path)
    store.load_problem(parse_problem(PROBLEM, DOMAIN))
    with store.transaction() as change:
        Executions(change).start(
            "run 1", "drive", {"r": "r", "from": "a", "to": "b"}, "/n", ["(clean c)"], ["(at r c)"]
        )
    store.close()


@pytest.mark.parametrize(
    "damage, reason",
    [
        ("UPDATE row SET place = 'first' WHERE kind = 'fact'", "the row 'fact' '.*its place is 'first'"),
        (
            'UPDATE row SET data = \'["battery", ["r"], "much", 0, "assign", null]\' WHERE kind = \'value\'',
            "the row 'value' 'battery r' .*'much' is not a number",
        ),
        ("UPDATE row SET data = '{' WHERE kind = 'goal'", "the row 'goal'"),
        ("UPDATE row SET data = '[]' WHERE kind = 'instance'", "the row 'instance' 'place a'"),
        ("UPDATE row SET data = 7 WHERE kind = 'instance'", "the row 'instance' 'place a'"),
        (
            "UPDATE row SET key = 'place' || char(31) || 'moon' WHERE kind = 'instance' AND key LIKE '%a'",
            "the row 'instance' 'place moon' .* holds 'place a'",
        ),
        ("UPDATE row SET kind = 'rumour' WHERE kind = 'metric'", "rows of the kind 'rumour' do not exist"),
        (
            'UPDATE row SET data = \'["run 1", {"operator": "drive"}]\' WHERE kind = \'execution\'',
            "the row 'execution' 'run 1' .*'since'",
        ),
        (
            "UPDATE row SET data = json_set(data, '$[1].since', 'noon') WHERE kind = 'execution'",
            "'noon' is not a whole number",
        ),
        ("UPDATE row SET data = json_set(data, '$[1].undo[0].was', 'odd') WHERE kind = 'execution'", "'odd'"),
        ("UPDATE row SET data = '" + "[" * 100_000 + "' WHERE kind = 'goal'", "the row 'goal'"),
        ("DELETE FROM meta", "the row 'format' of the table 'meta' is missing"),
        ("DELETE FROM meta WHERE name = 'version'", "the row 'version' of the table 'meta' is missing"),
        ("DELETE FROM meta WHERE name = 'digest'", "the row 'digest' of the table 'meta' is missing"),
        ("UPDATE meta SET value = 'new' WHERE name = 'version'", "'version' of the table 'meta' is 'new'"),
        ("UPDATE meta SET value = '0' WHERE name = 'version'", "'version' of the table 'meta' is '0'"),
        ("DROP TABLE meta", "the table 'meta' is missing"),
        ("DROP TABLE row", "the table 'row' is missing"),
        ("ALTER TABLE row RENAME COLUMN place TO spot", "no such column: place"),
    ],
)
def test_damaged_rows_are_named(path, damage, reason):
    filled(path)
    database = sqlite3.connect(path)
    database.execute(damage)
    database.commit()
    database.close()
    with pytest.raises(StateFileError, match=reason) as caught:
        open_store(path)
    assert str(path) in str(caught.value) and "start once with reset_state:=true" in str(caught.value)
    open_store(path, reset=True).close()


def test_damaged_texts_are_either_read_or_refused(path):
    filled(path)
    chance = random.Random(1)
    refused = 0
    for _ in range(300):
        database = sqlite3.connect(path)
        rows = database.execute("SELECT kind, key, data FROM row").fetchall()
        kind, key, data = chance.choice(rows)
        place = chance.randrange(len(data))
        wrong = (
            data[:place]
            + chance.choice(["", '"', "[", "}", "null", "0", "true", ",", "-"])
            + data[place + 1 :]
        )
        change = "UPDATE row SET data = ? WHERE kind = ? AND key = ?"
        database.execute(change, (wrong, kind, key))
        database.commit()
        database.close()
        try:
            open_store(path).close()
        except StateFileError as error:
            assert f"the row '{kind}'" in str(error)
            refused += 1
        database = sqlite3.connect(path)
        database.execute(change, (data, kind, key))
        database.commit()
        database.close()
    assert refused > 200
