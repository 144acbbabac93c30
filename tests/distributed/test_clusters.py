"""A cluster of our own keeps to this machine, and lost data is sent again a few times."""

from __future__ import annotations

import ipaddress
import pickle
from concurrent.futures import CancelledError
from types import SimpleNamespace

import pytest

from rasterjit.distributed import clusters


def listening(dask_scheduler):
    """Return the addresses that a scheduler's dashboard listens on."""
    return [one.getsockname()[0] for one in dask_scheduler.http_server._sockets.values()]


def test_dashboard_of_our_own_cluster_is_for_this_machine_alone(monkeypatch):
    said = []
    # Dask silences the handlers of pytest, where it is imported while tests are collected.
    monkeypatch.setattr(clusters.LOGGER, "info", lambda text, *rest: said.append(text % rest))
    monkeypatch.setattr(clusters, "available_processors", lambda: 1)
    with clusters.use_client(None) as own:
        found = own.run_on_scheduler(listening)
        assert said == [f"dashboard: {own.dashboard_link}"]
    assert found
    assert all(ipaddress.ip_address(one).is_loopback for one in found)


def test_what_is_lost_is_tried_again():
    done = []

    def take():
        done.append("take")
        if done.count("take") < clusters.MAX_ATTEMPTS:
            raise CancelledError
        return 7

    assert clusters.retry(take, "the scene", lambda: bool(done.append("again"))) == 7
    assert done == ["take", "again"] * (clusters.MAX_ATTEMPTS - 1) + ["take"]


@pytest.mark.parametrize("is_first", [True, False])
def test_data_that_is_lost_is_said_by_who_sends_it_again(monkeypatch, is_first):
    said, lost = [], [CancelledError(), CancelledError()]

    def take():
        if lost:
            raise lost.pop()

    monkeypatch.setattr(clusters.LOGGER, "warning", lambda text, *rest: said.append(text % rest))
    clusters.retry(take, "the scene", lambda: is_first and len(lost) == 1)
    assert said == ["all workers that held the scene were lost: it is sent again"] * is_first


class Client:
    """Stands for a client that loses its scheduler while it is asked for something."""

    scheduler = SimpleNamespace(address="tcp://there:1")

    def __init__(self, error, status="running"):
        self.error, self.status = error, status

    def fail(self, *arguments, **options):
        raise self.error

    nthreads = cancel = scatter = submit = fail


def errors_of_dask():
    from distributed.comm import CommClosedError

    return [
        CommClosedError("in <TCP (closed)>: Stream is closed"),
        OSError("Timed out trying to connect to tcp://there:1 after 30 s"),
        ConnectionRefusedError(111, "Connection refused"),
    ]


ASKED = {
    "threads": clusters.count_threads,
    "send": lambda client: clusters.send(1, client),
    "scatter": lambda client: clusters.scatter([1, 2], client),
    "submit": lambda client: clusters.submit(len, (), client=client),
}


@pytest.mark.parametrize("asked", ASKED)
def test_whatever_dask_says_of_a_lost_scheduler_is_a_connection_error(asked):
    for error in errors_of_dask():
        with pytest.raises(ConnectionError, match="scheduler at tcp://there:1 is lost"):
            ASKED[asked](Client(error))
        # Nothing is left that could be ended.
        clusters.cancel([None, object()], Client(error))
    with pytest.raises(RuntimeError, match="a bug"):
        ASKED[asked](Client(RuntimeError("a bug")))
    for status in clusters.CLOSED_STATUSES:
        with pytest.raises(ConnectionError, match="is lost"):
            ASKED[asked](Client(RuntimeError("Client is closed"), status))


def test_no_worker_is_not_a_lost_scheduler():
    with pytest.raises(ConnectionError, match="no worker came to the Dask scheduler at tcp://the"):
        clusters.send(1, Client(TimeoutError("No valid workers found")))


class Task:
    """Stands for a task that is done; its result fails to come."""

    def __init__(self, status, errors):
        self.status, self.errors = status, errors

    def add_done_callback(self, call):
        call(self)

    def result(self, timeout):
        if self.errors:
            raise self.errors.pop()
        return 7


def test_result_is_asked_for_again_while_a_connection_breaks(monkeypatch):
    monkeypatch.setattr(clusters, "POLL_SECONDS", 0.01)
    running = Client(None)
    assert clusters.wait_for_result(Task("finished", errors_of_dask()), running) == 7
    # What the task itself says of a file is its own.
    with pytest.raises(FileNotFoundError, match="mesh"):
        clusters.wait_for_result(Task("error", [FileNotFoundError(2, "no mesh")]), running)
    monkeypatch.setattr(clusters, "RECONNECT_TIMEOUT", 0.05)
    with pytest.raises(ConnectionError, match="is lost"):
        clusters.wait_for_result(Task("finished", errors_of_dask() * 1000), running)
    with pytest.raises(ConnectionError, match="is lost"):
        clusters.wait_for_result(Task("finished", []), Client(None, "connecting"))


def test_what_is_lost_again_and_again_is_given_up():
    done = []

    def take():
        done.append("take")
        raise CancelledError

    with pytest.raises(RuntimeError, match=r"held the scene were lost, 5 times.*memory limit"):
        clusters.retry(take, "the scene")
    assert len(done) == clusters.MAX_ATTEMPTS == 5


def test_other_errors_are_not_tried_again():
    done = []

    def take():
        done.append("take")
        raise ConnectionError("lost")

    with pytest.raises(ConnectionError, match="lost"):
        clusters.retry(take, "the scene")
    assert done == ["take"]


def make_list(*arguments):
    return [*arguments]


def test_each_thread_keeps_a_renderer_of_its_own():
    shared = clusters.SharedScene(make_list, 1, 2)
    with shared.renderer() as first, shared.renderer() as second:
        assert first == second == [1, 2]
        assert first is not second
    with shared.renderer() as third, shared.renderer() as fourth:
        assert {id(third), id(fourth)} == {id(first), id(second)}


def test_renderers_stay_where_they_are():
    shared = clusters.SharedScene(make_list, 1, 2)
    with shared.renderer() as first:
        first.append("drawn with")
    sent = pickle.loads(pickle.dumps(shared))
    assert sent.arguments == (1, 2)
    with sent.renderer() as other:
        assert other == [1, 2]
