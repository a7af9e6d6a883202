# SPDX-License-Identifier: Apache-2.0
"""The store of the protocol over a real etcd: its guarantees, and what it does when etcd hangs or dies."""

import queue
import socket
import threading
import time
from pathlib import Path
from typing import Any, Iterator, Tuple, Type

import grpc
import pytest

from merlin_fleet.certified import HubError, Tls, time_of
from merlin_fleet.core.store import Change, Compare, Put, Snapshot, Txn
from merlin_fleet.etcd_messages import LeaseUnknown, behind, message
from merlin_fleet.hub import EtcdHub
from merlin_fleet.hub_watch import Listener, Watch
from merlin_test import LONG
from merlin_test.etcd_process import EtcdProcess

pytestmark = pytest.mark.processes

ROOT = "/merlin/lab/"


class Heard(Listener):
    """Keeps the changes that it gets."""

    def __init__(self) -> None:
        self.events: queue.Queue[Tuple[str, Any]] = queue.Queue()

    def on_connected(self, snapshot: Snapshot) -> None:
        self.events.put(("connected", snapshot))

    def on_resumed(self) -> None:
        self.events.put(("resumed", None))

    def on_changed(self, changes: Tuple[Change, ...]) -> None:
        for change in changes:
            self.events.put(("changed", change))

    def on_disconnected(self, reason: str) -> None:
        self.events.put(("disconnected", reason))

    def connect(self) -> None:
        """Waits until it is connected; an attempt may fail where the hub's time-out is short."""
        while self.events.get(timeout=LONG)[0] != "connected":
            continue

    def next(self, kind: str) -> Any:
        """The next event, which is of this kind."""
        found, value = self.events.get(timeout=LONG)
        assert found == kind, value
        return value


@pytest.fixture(scope="module")
def shared() -> Iterator[EtcdProcess]:
    etcd = EtcdProcess()
    yield etcd
    etcd.close()


@pytest.fixture
def own() -> Iterator[EtcdProcess]:
    etcd = EtcdProcess()
    yield etcd
    etcd.close()


@pytest.fixture
def hubs() -> Iterator[Any]:
    made = []

    def make(etcd: EtcdProcess, root: str = ROOT, timeout: float = 20.0) -> EtcdHub:
        made.append(EtcdHub(root, [etcd.endpoint], timeout=timeout))
        return made[-1]

    yield make
    for hub in made:
        hub.close()


def put(hub: EtcdHub, key: str, value: str) -> int:
    return hub.transact(Txn(puts=(Put(key, value),))).revision


def test_a_transaction_compares_and_sets(shared: EtcdProcess, hubs: Any) -> None:
    hub, key = hubs(shared), ROOT + "compared"
    first = hub.transact(Txn((Compare(key, 0),), (Put(key, "a"),)))
    assert first.done
    second = hub.transact(Txn((Compare(key, 0),), (Put(key, "b"),), reads=(key,)))
    assert not second.done
    assert [(item.value, item.modified) for item in second.items] == [("a", first.revision)]
    third = hub.transact(Txn((Compare(key, first.revision),), (Put(key + "2", "c"),), (key,)))
    assert third.done
    assert {item.key for item in hub.read().items if "compared" in item.key} == {key + "2"}


def test_a_lease_ends_its_keys(shared: EtcdProcess, hubs: Any) -> None:
    hub, key = hubs(shared), ROOT + "leased"
    lease, ttl = hub.grant(30.0)
    assert ttl >= 30.0
    assert hub.renew(lease) == ttl
    hub.transact(Txn(puts=(Put(key, "a", lease),)))
    assert key in {item.key for item in hub.read().items}
    hub.revoke(lease)
    assert key not in {item.key for item in hub.read().items}
    assert hub.renew(lease) == 0.0
    with pytest.raises(LeaseUnknown):
        hub.transact(Txn(puts=(Put(key, "a", lease),)))


def test_more_keys_than_a_page_are_read_at_one_revision(shared: EtcdProcess, hubs: Any) -> None:
    hub = hubs(shared, "/merlin/many/")
    for begin in range(0, 1200, 100):
        puts = tuple(Put(f"/merlin/many/{number:04}", "x") for number in range(begin, begin + 100))
        revision = hub.transact(Txn(puts=puts)).revision
    snapshot = hub.read()
    assert len(snapshot.items) == 1200
    assert snapshot.revision == revision


def test_changes_of_the_own_fleet_come_in_order(shared: EtcdProcess, hubs: Any) -> None:
    hub, heard = hubs(shared, "/merlin/order/"), Heard()
    hub.follow(heard)
    heard.next("connected")
    put(hub, "/merlin/other/key", "not ours")
    revisions = [put(hub, f"/merlin/order/{number}", str(number)) for number in range(50)]
    hub.transact(Txn(deletes=("/merlin/order/7",)))
    changes = [heard.next("changed") for _ in range(51)]
    assert [change.modified for change in changes[:50]] == revisions
    assert changes[50] == Change("/merlin/order/7", None, revisions[-1] + 1)


def test_a_key_that_is_not_a_text_does_not_end_the_changes(own: EtcdProcess, hubs: Any) -> None:
    hub, writer, heard = hubs(own), hubs(own), Heard()
    writer.ask("KV/Put", message("PutRequest", key=ROOT.encode() + b"goals/\xff", value=b"\xff"))
    hub.follow(heard)
    kind, snapshot = heard.events.get(timeout=LONG)
    assert kind == "connected", snapshot
    assert [item.key for item in snapshot.items] == [ROOT + "goals/\ufffd"]
    assert put(writer, ROOT + "a", "1") == heard.next("changed").modified


@pytest.mark.parametrize("error", [KeyError, ValueError])
def test_a_listener_that_raises_gets_everything_anew(
    shared: EtcdProcess,
    hubs: Any,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
    error: Type[Exception],
) -> None:
    hub, writer, heard = hubs(shared), hubs(shared), Heard()
    raised = threading.Event()

    def on_changed(changes: Tuple[Change, ...]) -> None:
        if not raised.is_set():
            raised.set()
            raise error("a mistake of the listener")
        Heard.on_changed(heard, changes)

    monkeypatch.setattr(heard, "on_changed", on_changed)
    hub.follow(heard)
    heard.next("connected")
    first = put(writer, ROOT + "raises", "1")
    assert "a mistake of the listener" in heard.next("disconnected")
    assert first in [item.modified for item in heard.next("connected").items]
    assert put(writer, ROOT + "raises", "2") == heard.next("changed").modified
    assert "Traceback" in capsys.readouterr().err


def test_nothing_is_lost_when_etcd_is_killed(own: EtcdProcess, hubs: Any) -> None:
    hub, writer, heard = hubs(own), hubs(own), Heard()
    hub.follow(heard)
    heard.next("connected")
    first = put(writer, ROOT + "a", "1")
    assert heard.next("changed").modified == first
    own.kill()
    heard.next("disconnected")
    own.start()
    missed = [put_until_it_is_there(writer, ROOT + f"b{number}") for number in range(5)]
    heard.next("resumed")
    assert [heard.next("changed").modified for _ in missed] == missed


def put_until_it_is_there(hub: EtcdHub, key: str) -> int:
    """Puts a key; etcd has just begun."""
    end = time.monotonic() + LONG
    while True:
        try:
            return hub.transact(Txn((Compare(key, 0),), (Put(key, "x"),))).revision
        except HubError:
            assert time.monotonic() < end


def test_a_hub_that_hangs_is_noticed_and_nothing_is_lost(own: EtcdProcess, hubs: Any) -> None:
    hub, heard = hubs(own, timeout=1.0), Heard()
    hub.follow(heard)
    heard.connect()
    # Changes follow a key that is known; of an empty hub everything is read again.
    revision = put_until_it_is_there(hubs(own), ROOT + "first")
    while heard.events.get(timeout=LONG) != ("changed", Change(ROOT + "first", "x", revision)):
        continue
    own.hang()
    with pytest.raises(HubError, match="in time"):
        put(hub, ROOT + "a", "1")
    heard.next("disconnected")
    own.resume()
    revision = put_until_it_is_there(hubs(own), ROOT + "b")
    # The put whose answer did not come may have been done; a busy machine may need more than a second again.
    while True:
        kind, value = heard.events.get(timeout=LONG)
        assert kind != "connected", "all was read again"
        if kind == "changed" and value.modified == revision:
            break


def test_what_was_compacted_meanwhile_is_read_again(
    own: EtcdProcess, hubs: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub, writer, heard = hubs(own), hubs(own), Heard()
    hub.follow(heard)
    heard.next("connected")
    own.kill()
    heard.next("disconnected")
    compacted, where = threading.Event(), hub._where

    def late() -> Tuple[int, int]:
        assert compacted.wait(LONG)
        return where()

    monkeypatch.setattr(hub, "_where", late)
    own.start()
    for number in range(5):
        last = put_until_it_is_there(writer, ROOT + f"b{number}")
    writer.ask("KV/Compact", message("CompactionRequest", revision=last))
    compacted.set()
    kind, snapshot = heard.events.get(timeout=LONG)
    while kind != "connected":
        assert kind != "changed"
        kind, snapshot = heard.events.get(timeout=LONG)
    assert [item.key for item in snapshot.items] == [ROOT + f"b{number}" for number in range(5)]
    revision = put(writer, ROOT + "c", "1")
    assert heard.next("changed").modified == revision


class Late(Heard):
    """Keeps the hub from following its keys after a loss."""

    def __init__(self) -> None:
        super().__init__()
        self.go = threading.Event()

    def on_disconnected(self, reason: str) -> None:
        super().on_disconnected(reason)
        assert self.go.wait(LONG)


def test_what_was_written_and_not_delivered_yet_is_missed_in_a_backup(
    own: EtcdProcess, hubs: Any, tmp_path: Path
) -> None:
    hub, heard = hubs(own), Late()
    hub.follow(heard)
    heard.next("connected")
    first = put(hub, ROOT + "a", "1")
    assert heard.next("changed").modified == first
    own.kill()
    heard.next("disconnected")
    own.start()
    own.save(tmp_path / "snapshot")
    put_until_it_is_there(hub, ROOT + "b")
    own.kill()
    own.put_back(tmp_path / "snapshot")
    own.start()
    heard.go.set()
    snapshot = heard.next("connected")
    assert snapshot.another
    assert [item.key for item in snapshot.items] == [ROOT + "a"]


def test_a_lease_is_renewed_on_a_machine_without_further_threads(
    shared: EtcdProcess, hubs: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    hub = hubs(shared)
    lease, ttl = hub.grant(60.0)

    def none_left(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", none_left)
    assert hub.renew(lease) == ttl


class Removed(grpc.RpcError):
    """An error of gRPC's own."""

    def code(self) -> grpc.StatusCode:
        return grpc.StatusCode.UNKNOWN

    def details(self) -> str:
        return "Stream removed"


def test_a_look_into_the_history_that_fails_is_repeated(
    own: EtcdProcess, hubs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at, failed = threading.Event(), threading.Event()

    class History(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc]
        """Fails at the first look into the history."""

        def intercept_unary_unary(self, answer: Any, details: Any, request: Any) -> Any:
            if looked_at.is_set() and getattr(request, "revision", 0) and not failed.is_set():
                failed.set()
                raise Removed
            return answer(details, request)

    channel = grpc.insecure_channel
    monkeypatch.setattr(
        grpc, "insecure_channel", lambda *given: grpc.intercept_channel(channel(*given), History())
    )
    hub, writer, heard = hubs(own), hubs(own, "/elsewhere/"), Late()
    hub.follow(heard)
    heard.next("connected")
    own.save(tmp_path / "snapshot")
    last = put(hub, ROOT + "a", "1")
    assert heard.next("changed").modified == last
    own.kill()
    heard.next("disconnected")
    own.put_back(tmp_path / "snapshot")
    own.start()
    while put_until_it_is_there(writer, f"/elsewhere/{time.monotonic_ns()}") <= last:
        continue
    looked_at.set()
    heard.go.set()
    assert heard.next("connected").another
    assert failed.is_set()


def test_that_it_is_another_hub_is_said_also_after_a_stream_that_did_not_begin(shared: EtcdProcess) -> None:
    with grpc.insecure_channel(shared.endpoint) as channel:

        class Once(Heard):
            """Ends the stream when it has begun."""

            def on_connected(self, snapshot: Snapshot) -> None:
                super().on_connected(snapshot)
                channel.close()

        heard = Once()
        watch = Watch(heard, ROOT.encode(), behind(ROOT.encode()))
        watch.restart(1, Snapshot(5, ()), another=True)
        watch.restart(1, Snapshot(6, ()), another=False)
        with pytest.raises((grpc.RpcError, HubError)):
            watch.run(channel, LONG)
    assert heard.next("connected").another


def test_without_certificates_only_this_machine_is_used() -> None:
    with pytest.raises(HubError, match=r"not hub\.lab:2379"):
        EtcdHub(ROOT, ["127.0.0.1:2379", "hub.lab:2379"])
    with pytest.raises(HubError, match="cannot be read"):
        EtcdHub(ROOT, ["hub.lab:2379"], Tls("/nowhere/ca.pem", "/nowhere/c.pem", "/nowhere/k.pem"))


def test_a_hub_that_is_not_there_is_reported_once(hubs: Any, own: EtcdProcess) -> None:
    own.kill()
    hub, heard = hubs(own), Heard()
    hub.follow(heard)
    assert "cannot be reached" in heard.next("disconnected")
    own.start()
    heard.next("connected")
    assert heard.events.empty()


def test_the_hub_tells_its_time(shared: EtcdProcess) -> None:
    hub = EtcdHub(ROOT, [shared.endpoint], timeout=20.0)
    before = time.time()
    reported = hub.time()
    assert before - 1.0 <= reported <= time.time() + 1.0
    hub.close()


@pytest.mark.parametrize(
    "answer",
    [b"", b"\0\0\x18\4\0\0\0\0\0", b"HTTP/1.1 200 OK\r\n\r\n", b"HTTP/1.1 200 OK\r\nDate: today\r\n\r\n"],
)
def test_what_tells_no_time_is_an_error(answer: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            stream, _ = server.accept()
            with stream:
                stream.recv(1000)
                stream.sendall(answer)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        with pytest.raises(HubError, match="does not tell its time"):
            time_of(f"127.0.0.1:{server.getsockname()[1]}", None, 20.0)
        thread.join()
