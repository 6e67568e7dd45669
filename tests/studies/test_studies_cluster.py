"""Clusters: what their processes keep of the past is bounded; schedulers without workers, and those that end."""

import json

import pytest
from support.processes import PATIENCE_S, end_with_children, start_dask, wait_until

from ps_fmu.studies import cluster, scheduler
from ps_fmu.studies.parts import list_parts
from ps_fmu.studies.rows import ClusterError
from ps_fmu.studies.study_folder import open_folder


def count_messages(dask_scheduler):
    """How many messages to each worker the scheduler keeps, at most."""
    return [comm.recent_message_log.maxlen for comm in dask_scheduler.stream_comms.values()]


def ask_worker():
    """Whether this worker takes its profile, and how much it may keep of what it measures and does."""
    from distributed import get_worker

    worker = get_worker()
    return "profile" in worker.periodic_callbacks, worker.monitor.maxlen, worker.state.log.maxlen


def test_processes_do_not_grow_with_the_time_that_a_study_takes():
    with cluster.connect(None, 1) as client:
        profiled, samples, transitions = client.submit(ask_worker, pure=False).result()
        monitored = client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.monitor.maxlen)
        messages = [*client.run_on_scheduler(count_messages), client.scheduler_comm.recent_message_log.maxlen]
    assert not profiled
    assert monitored == samples <= 1000
    assert transitions <= 10
    assert len(messages) == 2 and max(messages) <= 10  # each may have all values of a batch


@pytest.mark.parametrize(
    ("address", "problem"),
    [("node1", "missing port number in address 'node1'"), ("node://x:1", "unknown address scheme")],
)
def test_what_is_no_address_is_said_without_asking_for_it(address, problem, monkeypatch):
    """A client of it would ask for twice its time-out, and then print a traceback."""
    monkeypatch.setattr("distributed.Client", None)
    with pytest.raises(ClusterError, match=f"--scheduler {address}: {problem}"), cluster.connect(address, None):
        pass


def test_a_scheduler_without_workers_is_said(make_prepared, tmp_path, monkeypatch):
    monkeypatch.setattr(scheduler, "WATCH_S", 0.2)
    monkeypatch.setattr(scheduler, "NO_WORKER_S", 1.0)
    file = tmp_path / "scheduler.json"
    process = start_dask("scheduler", "--port", "0", "--scheduler-file", str(file))
    try:
        wait_until(lambda: file.is_file() and file.read_text().strip())
        prepared = make_prepared()
        with cluster.connect(json.loads(file.read_text())["address"], None, PATIENCE_S) as client:
            dispatcher = cluster.Dispatcher(
                client, prepared.plan, prepared.identity.plan_sha256, prepared.bundle, tmp_path, lambda *_: None
            )
            with pytest.raises(ClusterError, match="has had no worker for 1 s"):
                dispatcher.run([0])
    finally:
        end_with_children(process)


@pytest.mark.parametrize("moment", ["before the first batch", "when a batch has come in"])
def test_a_scheduler_that_ends_is_noticed(moment, make_prepared, hand_started, tmp_path):
    """At once, although the scheduler had long to answer at first: dask's client asks it again for that long."""
    (_, address, *_), (process, *_) = hand_started
    prepared, folder = make_prepared(), tmp_path / "out"
    name = prepared.identity.plan_sha256
    folder.mkdir()
    open_folder(folder, prepared.plan, prepared.identity, resume=False)

    def end(*_):
        end_with_children(process)

    with cluster.connect(address, None, PATIENCE_S) as client:
        dispatcher = cluster.Dispatcher(client, prepared.plan, name, prepared.bundle, folder, end)
        if moment == "before the first batch":
            end()
        with pytest.raises(ClusterError, match=f"the scheduler {address} is lost"):
            dispatcher.run(range(len(prepared.plan)))
    assert bool(list_parts(folder, name)) == (moment == "when a batch has come in")
