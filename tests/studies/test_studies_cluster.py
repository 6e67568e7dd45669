"""The cluster on this machine: what its processes keep of the past is bounded."""

from ps_fmu.studies import cluster


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
