# SPDX-License-Identifier: Apache-2.0
"""Defects U1 to U6 and U8: userdata is safe between threads, honest about its keys, and belongs to a run."""

import copy
import enum
import pickle
import threading

import pytest

import smach


class Thing:
    """A value with attributes, items and a method."""

    def __init__(self):
        self.name = "thing"
        self.items = [1, 2, 3]

    def __len__(self):
        return len(self.items)

    def __getitem__(self, i):
        return self.items[i]

    def __setitem__(self, i, value):
        self.items[i] = value

    def __call__(self, x):
        return (self.name, x)

    def __eq__(self, other):
        return isinstance(other, Thing) and other.name == self.name

    def __add__(self, other):
        return self.items + other.items


def test_u1_operations_of_many_threads_do_not_disturb_one_another():
    ud = smach.UserData()
    ud.count = 0
    failures = []

    def work(number):
        try:
            for i in range(300):
                ud[f"k{number}_{i}"] = i
                other = smach.UserData()
                other[f"u{number}_{i}"] = i
                ud.update(other)
                assert f"k{number}_{i}" in ud.keys()  # noqa: SIM118
                with ud.locked():
                    ud.count = ud.count + 1
        except Exception as error:
            failures.append(error)

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    assert ud.count == 4 * 300
    assert len(ud.keys()) == 1 + 2 * 4 * 300


@pytest.mark.parametrize(
    "operation", ["ud['x'] = 1", "ud['y']", "'y' in ud", "ud.keys()", "ud.update(other)"]
)
def test_u1_every_operation_takes_the_lock(operation):
    ud, other = smach.UserData(), smach.UserData()
    ud.y = other.z = 1
    done = threading.Event()

    def work():
        exec(operation, {"ud": ud, "other": other})
        done.set()

    with ud.locked():
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        assert not done.wait(0.05)
    assert done.wait(60.0)
    thread.join()


def read(value, output=False):
    """What a state reads of a value, as input key or as input and output key."""
    ud = smach.UserData()
    ud.x = value
    return smach.Remapper(ud, ["x"], ["x"] if output else []).x


def test_u2_writing_to_an_input_value_raises_and_changes_nothing():
    thing = Thing()
    view = read(thing)
    for write in ("view.name = 'new'", "view.other = 1", "view[0] = 9", "del view.name"):
        with pytest.raises(TypeError, match="read-only"):
            exec(write, {"view": view})
    assert thing.name == "thing" and thing.items == [1, 2, 3] and not hasattr(thing, "other")


def test_u2_input_value_behaves_as_the_value():
    thing = Thing()
    view = read(thing)
    assert isinstance(view, Thing)
    assert view(5) == ("thing", 5)
    assert len(view) == 3 and view[1] == 2 and list(view) == [1, 2, 3]
    assert view == thing and thing == view and view != 3
    assert view + view == [1, 2, 3, 1, 2, 3]
    assert repr(view) == repr(thing)
    assert type(copy.deepcopy(view)) is Thing
    assert type(pickle.loads(pickle.dumps(view))) is Thing
    assert not callable(read(type("Plain", (), {})()))
    assert read(len) is len and read(Thing) is Thing and read(work_on) is work_on


def work_on(x):
    return x


class Mode(enum.Enum):
    FAST = 1


class Room(str, enum.Enum):
    HALL = "hall"


def test_u2_values_that_cannot_change_are_themselves(kit):
    def look(ud):
        assert ud.mode == Mode.FAST and ud.mode in [Mode.FAST] and {Mode.FAST: 1}[ud.mode] == 1
        assert "to " + ud.room == "to hall" and "hall".startswith(ud.room)
        with pytest.raises(ValueError, match="broken"):
            raise ud.error
        return "done"

    sm = smach.StateMachine(["done"])
    sm.userdata.update({"mode": Mode.FAST, "room": Room.HALL, "error": ValueError("broken")})
    with sm:
        smach.StateMachine.add("A", kit.Calling(look, input_keys=["mode", "room", "error"]))
    assert sm.execute() == "done"


def test_u2_io_value_is_the_value_itself():
    thing = Thing()
    view = read(thing, output=True)
    assert view is thing
    view.name = "new"
    assert thing.name == "new"


def test_u2_value_written_on_is_stored_without_its_view():
    ud = smach.UserData()
    ud.a = thing = Thing()
    view = smach.Remapper(ud, ["a"], ["b"])
    view.b = view.a
    assert ud.b is thing


def test_u3_writing_an_undeclared_key_raises(kit, log):
    def write(ud):
        ud.y = 1
        return "done"

    sm = kit.machine(kit.Calling(write, input_keys=["x"], output_keys=["z"]))
    with pytest.raises(smach.InvalidUserCodeError, match=r"(?s)'y'.*'z'"):
        sm.execute()
    smach.set_strict_userdata(False)
    try:
        assert sm.execute() == "done"
        assert "y" not in sm.userdata
        assert any("'y'" in text for level, text in log if level == "error")
    finally:
        smach.set_strict_userdata(True)


def test_u4_missing_key_says_which_and_hasattr_is_false():
    ud = smach.UserData()
    ud.there = 1
    assert not hasattr(ud, "missing")
    for wrong in (AttributeError, KeyError):
        with pytest.raises(wrong, match="(?s)missing.*there"):
            ud.missing  # noqa: B018
    with pytest.raises(KeyError, match="missing"):
        ud["missing"]
    ud["_private"] = 2
    assert ud["_private"] == 2 and "_private" in ud


@pytest.mark.parametrize("operation", ["view._x", "view['_x']", "setattr(view, '_x', 1)", "ud._y"])
def test_n2_key_that_begins_with_an_underscore_says_that_it_is_an_item(operation):
    ud = smach.UserData()
    ud._x = 1  # an attribute of Python, as in SMACH
    view = smach.Remapper(ud, ["_x"], ["_x"])
    with pytest.raises(AttributeError, match=r"userdata\['_[xy]'\]"):
        eval(operation, {"ud": ud, "view": view})
    view["_x"] = 2
    assert view["_x"] == 2


def test_u5_keys_under_remapping_are_those_of_the_state():
    ud = smach.UserData()
    ud.theirs, ud.b = 1, 2
    view = smach.Remapper(ud, ["mine", "b", "absent"], ["out"], {"mine": "theirs", "out": "o"})
    assert sorted(view.keys()) == ["b", "mine"]
    assert "mine" in view and "absent" not in view and "theirs" not in view
    other = smach.UserData()
    other.out = 3
    view.update(other)
    assert ud.o == 3
    other.undeclared = 4
    with pytest.raises(smach.InvalidUserCodeError):
        view.update(other)


def test_u6_userdata_of_a_run_is_there_in_the_next_unless_runs_begin_clean(kit):
    seen = []

    def look(ud):
        seen.append(sorted(ud.keys()))
        ud.result = 1
        ud.count = ud.count + 1
        return "done"

    sm = kit.machine(kit.Calling(look, io_keys=["result", "count", "preset"]))
    sm.userdata.count = 0
    sm.keeps_userdata = False
    assert sm.execute() == "done"
    assert sm.userdata.result == 1, "after a run its results are there"
    sm.userdata.preset = 2
    assert sm.execute() == "done"
    assert seen == [["count"], ["count", "preset"]]
    assert sm.userdata.count == 2, "what was set from outside lives on"
    sm.keeps_userdata = True
    assert sm.execute() == "done"
    assert seen[-1] == ["count", "preset", "result"]
    sm.keeps_userdata = False
    assert sm.execute() == "done"
    assert seen[-1] == ["count", "preset"], "also of the run before the last"


def test_u6_a_preempted_search_continues_where_it_was_interrupted(kit):
    """A program of users: rooms to search are userdata, of which a state takes one after another."""
    searched, hang = [], threading.Event()

    def take(ud):
        if "room" not in ud or not ud.room:
            ud.room = ud.rooms.pop(0)
        return "done"

    class Search(kit.Waiting):
        def __init__(self):
            super().__init__()
            self.register_io_keys(["room"])

        def execute(self, ud):
            searched.append(ud.room)
            outcome = "done" if hang.is_set() else super().execute(ud)
            if outcome == "done":
                ud.room = ""
            return outcome

    search = Search()
    both = smach.Concurrence(["done", "preempted"], "done", input_keys=["room"], output_keys=["room"])
    with both:
        smach.Concurrence.add("SEARCH", search)
    one = smach.StateMachine(["done", "preempted"])
    with one:
        take_state = kit.Calling(take, io_keys=["rooms", "room"])
        smach.StateMachine.add("TAKE", take_state, {"done": "BOTH"})
        smach.StateMachine.add("BOTH", both)
    one.userdata.rooms = ["kitchen", "hall"]
    run = kit.Running(one)
    assert search.started.wait(kit.LIMIT)
    one.request_preempt()
    assert run.end() == "preempted"
    hang.set()
    assert [one.execute(), one.execute()] == ["done", "done"]
    assert searched == ["kitchen", "kitchen", "hall"]


def test_u6_key_that_another_thread_sets_during_a_run_is_there_in_the_next(kit):
    seen = []
    sm = smach.StateMachine(["done"])
    sm.keeps_userdata = False

    def meanwhile(ud):
        other = threading.Thread(target=lambda: sm.userdata.update({"order": 5}))
        other.start()
        other.join()
        seen.append(sorted(sm.userdata.keys()))
        sm.userdata.own = 1
        return "done"

    with sm:
        smach.StateMachine.add("A", kit.Calling(meanwhile))
    sm.execute()
    sm.execute()
    assert seen == [["order"], ["order"]]


def test_u6_what_a_thread_of_a_state_writes_belongs_to_the_run(kit):
    seen = []
    sm = smach.StateMachine(["done"])
    sm.keeps_userdata = False

    def asks(ud):
        seen.append(sorted(sm.userdata.keys()))
        other = threading.Thread(target=lambda: ud.update({"answer": 5}), name="answers")
        other.start()
        other.join()
        return "done"

    with sm:
        smach.StateMachine.add("A", kit.Calling(asks, output_keys=["answer"]))
    sm.execute()
    assert sm.userdata.answer == 5
    sm.execute()
    assert seen == [[], []]


def test_u6_nested_machine_does_not_see_inputs_of_an_earlier_run(kit):
    seen = []
    inner = smach.StateMachine(["done"], input_keys=["x"], output_keys=["y"])
    inner.keeps_userdata = False

    def look(ud):
        seen.append("x" in ud)
        if "x" in ud:
            ud.y = ud.x
        return "done"

    with inner:
        smach.StateMachine.add("A", kit.Calling(look, io_keys=["x", "y"]))
    parent = smach.UserData()
    parent.x = 7
    inner.execute(parent)
    assert parent.y == 7
    empty = smach.UserData()
    inner.execute(empty)
    assert seen == [True, False] and "y" not in empty


def test_u8_outputs_reach_the_parent_when_a_child_raises(kit):
    def fail(ud):
        ud.progress = "half"
        raise ValueError("broken")

    sm = smach.StateMachine(["done"], output_keys=["progress"])
    with sm:
        smach.StateMachine.add("A", kit.Calling(fail, output_keys=["progress"]))
    parent = smach.UserData()
    with pytest.raises(smach.InvalidUserCodeError, match="broken"):
        sm.execute(parent)
    assert parent.progress == "half"


def test_u8_constants_are_read_by_their_state_only(kit):
    seen = []

    def look(ud):
        seen.append(ud.speed if "speed" in ud else None)
        return "done"

    sm = smach.StateMachine(["done"])
    with sm:
        smach.StateMachine.add(
            "A", kit.Calling(look, input_keys=["speed"]), {"done": "B"}, constants={"speed": 3}
        )
        smach.StateMachine.add("B", kit.Calling(look, input_keys=["speed"]))
    assert sm.execute() == "done"
    assert seen == [3, None] and "speed" not in sm.userdata
    sm.userdata.speed = 1
    sm.execute()
    assert seen[2:] == [3, 1]


def test_reading_an_undeclared_key_raises(kit):
    sm = kit.machine(kit.Calling(lambda ud: ud.x))
    sm.userdata.x = "done"
    with pytest.raises(smach.InvalidUserCodeError, match="'x'"):
        sm.execute()


def test_extract_and_merge_rename_and_copy():
    ud = smach.UserData()
    ud.theirs = value = [1]
    part = ud.extract(["mine"], {"mine": "theirs"})
    assert part.mine == [1] and part.mine is not value
    other = smach.UserData()
    other.merge(part, ["mine"], {"mine": "again"})
    assert other.again == [1]
