"""The cluster on this machine: what its processes keep of the past is bounded."""

import pytest

from ps_fmu.studies import cluster
from ps_fmu.studies.rows import ClusterError


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
