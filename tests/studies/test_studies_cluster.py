"""Clusters: what their processes keep of the past is bounded; schedulers and workers that end."""

import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
from pathlib import Path

import dask
import psutil
import pytest
import yaml
from support.claims import verify_claim
from support.processes import PATIENCE_S, end_with_children, start_dask, wait_for_scheduler, wait_until

import ps_fmu
from ps_fmu.studies import cluster
from ps_fmu.studies.bundle import open_folder
from ps_fmu.studies.rows import DONE, KILLED, ClusterError, RowStore, VersionError

from .conftest import start_by_hand


def count_messages(dask_scheduler):
    """How many messages to each worker the scheduler keeps, at most."""
    return [comm.recent_message_log.maxlen for comm in dask_scheduler.stream_comms.values()]


def ask_worker():
    """Whether this worker takes its profile, and how much it may keep of what it measures and does."""
    from distributed import get_worker

    worker = get_worker()
    return "profile" in worker.periodic_callbacks, worker.monitor.maxlen, worker.state.log.maxlen


def leave(_):
    """End the worker."""
    os._exit(1)


@pytest.fixture(scope="module")
def local():
    """A cluster of one worker.  What it is started with ends with it: other programs of this process do not get it."""
    before = dict(os.environ)
    with cluster.connect(None, 1) as client:
        assert client.submit(os.getenv, "PYTHONSAFEPATH", pure=False).result() == "1"
        yield client
    assert dict(os.environ) == before


def test_processes_do_not_grow_with_the_time_that_a_study_takes(local):
    profiled, samples, transitions = local.submit(ask_worker, pure=False).result()
    monitored = local.run_on_scheduler(lambda dask_scheduler: dask_scheduler.monitor.maxlen)
    messages = [*local.run_on_scheduler(count_messages), local.scheduler_comm.recent_message_log.maxlen]
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


def test_a_scheduler_without_workers_is_said(make_prepared, tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(cluster, "WATCH_S", 0.2)
    monkeypatch.setattr(cluster, "SILENT_S", 0.1)
    monkeypatch.setattr(cluster, "NO_WORKER_S", 1.0)
    file = tmp_path / "scheduler.json"
    process = start_dask("scheduler", "--port", "0", "--scheduler-file", str(file))
    try:
        address, prepared = wait_for_scheduler(file), make_prepared()
        said = pytest.raises(ClusterError, match=f"the scheduler {address} has had no worker for 1 s")
        with cluster.connect(address, None, PATIENCE_S) as client, said:
            dispatch(client, (prepared, tmp_path))
        warning = f"the scheduler {address} has no worker: the study ends if none comes within 1 s"
        assert capfd.readouterr().err.count(warning) == 1
    finally:
        end_with_children(process)


@pytest.fixture
def opened(make_prepared, tmp_path):
    """A study of six cases, prepared, and its output folder."""
    prepared, folder = make_prepared(), tmp_path / "out"
    folder.mkdir()
    open_folder(folder, prepared.plan, prepared.identity, resume=False)
    return prepared, folder


def make_dispatcher(client, opened):
    prepared, folder = opened
    return cluster.Dispatcher(client, prepared.plan, prepared.identity.plan_sha256, prepared.bundle, folder)


def dispatch(client, opened, report=lambda *_: None):
    """Run all cases of a study."""
    dispatcher = make_dispatcher(client, opened)
    dispatcher.run(range(len(dispatcher._plan)), (), report)


def list_cases(opened):
    """The cases that have rows."""
    prepared, folder = opened
    return list(RowStore(folder, prepared.identity.plan_sha256).read_statuses())


def test_workers_remove_the_files_of_a_study_when_the_next_one_begins(make_prepared, tmp_path, local):
    """On a long-lived cluster the FMUs of all studies would fill the disk."""
    studies = []
    for duration in ("0.1 s", "0.2 s"):
        folder = tmp_path / f"of {duration}"
        folder.mkdir()
        prepared = make_prepared(changes={"0.1 s": duration})
        open_folder(folder, prepared.plan, prepared.identity, resume=False)
        studies.append((prepared, folder))
    for opened in studies:
        dispatch(local, opened)
        (scratch,) = local.run(lambda dask_worker: dask_worker.local_directory).values()
        (left,) = Path(scratch).glob("study_*")
        assert left.name.startswith(f"study_{opened[0].bundle.sha256[:16]}_")


def test_what_stops_is_noticed_within_ten_seconds(monkeypatch):
    """A worker at the third sign of life that is due, whatever the clocks say; and not if the command was stopped."""
    clock = [1e6]
    monkeypatch.setattr("time.monotonic", lambda: clock[0])
    silences = cluster.Silences()

    def look(seconds):
        """Of a worker that is heard of each half a second, until it is stopped after 20 s, and one that goes on."""
        clock[0] += seconds
        heard = 0.5 * ((clock[0] - 1e6) // 0.5)
        return silences.find({"stops": {"last_seen": min(heard, 20.0)}, "goes on": {"last_seen": heard}})

    found = {since: look(1.0) for since in range(1, 31)}
    first = next(since for since in found if found[since])
    assert found[first] == found[30] == look(3600.0) == {"stops"}
    silences = cluster.Silences()
    assert [silences.find({"one": {"last_seen": 5.0}}) for clock[0] in (1e7, 1e7 + 0.1, 2e7, 2e7 + 0.1)] == [set()] * 4
    verify_claim(
        "master.stopped_processes",
        claim="A scheduler or a worker that is stopped is named within 10 s",
        where="`ps-fmu sweep --scheduler`: terminal",
        reference="the times that looks at a scheduler take at most; a worker whose last sign of life is known, with "
        "clocks that differ; a command that was stopped itself, which names nobody",
        error=[cluster.UNANSWERED * (cluster.WATCH_S + cluster.ANSWER_S), first - 20.0],
        bound=10.0,
        unit="s",
    )


def test_what_a_worker_had_that_is_stopped_runs_elsewhere(opened, tmp_path, monkeypatch, capfd):
    """Without a nanny, which would start it anew."""
    monkeypatch.setattr(cluster, "SILENT_S", 1.0)
    with (
        start_by_hand(tmp_path, 1, "--no-nanny") as (address, processes),
        cluster.connect(address, None, PATIENCE_S) as client,
    ):

        def stop(*_):
            if not stopped:
                stopped.extend(client.run(os.getpid).values())
                os.kill(stopped[0], signal.SIGSTOP)
                processes.append(start_dask("worker", address, "--local-directory", str(tmp_path)))

        stopped = []
        dispatch(client, opened, stop)
        assert list_cases(opened) == list(range(6))
        assert stopped[0] not in client.run(os.getpid).values()
    assert "worker node1 (tcp://" in (said := capfd.readouterr().err)
    assert "has not been heard of for 1 s: it is stopped, or its machine" in said


def test_a_worker_with_other_modules_or_without_any_is_refused(opened, tmp_path):
    """Releases may be the same; a worker without ps_fmu would end by the first that it gets."""
    copy = tmp_path / "copy"
    shutil.copytree(Path(ps_fmu.__file__).parent, copy / "ps_fmu", ignore=shutil.ignore_patterns("__pycache__"))
    with (copy / "ps_fmu" / "pointing" / "indices.py").open("a") as file:
        file.write("# a change\n")
    other = f"import sys; sys.path.insert(0, {str(copy)!r})"
    none = (
        "import importlib.metadata as m; real = m.version; "
        "m.version = lambda name: real('no_such_package' if name == 'ps_fmu' else name)"
    )
    cases = (
        (other, r"worker odd@.* has ps_fmu \S+ \(modules \w{12}\) instead of \S+ \(modules \w{12}\): its rows"),
        (none, r"worker odd \(tcp://.*\) has ps_fmu not installed instead of [\d.]+: its rows would differ"),
    )
    named = ("--name", "odd", "--no-nanny", "--local-directory", str(tmp_path))
    with start_by_hand(tmp_path, 0) as (address, processes):
        for beginning, problem in cases:
            processes.append(start_dask("worker", address, *named, beginning=beginning))
            refused = pytest.raises(VersionError, match=problem)
            with cluster.connect(address, None, PATIENCE_S) as client, refused:
                dispatch(client, opened)
            end_with_children(processes[-1])
    assert list_cases(opened) == []


def test_a_study_goes_over_tls(opened, tmp_path):
    """As docs/studies.md says: one certificate, made by openssl, for all."""
    manual = (Path(__file__).parents[2] / "docs" / "studies.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"^openssl .*$", manual, re.MULTILINE)
    subprocess.run(shlex.split(command), cwd=tmp_path, check=True, capture_output=True)
    (settings,) = re.findall(r"```yaml\n(.*?)```", manual, re.DOTALL)
    config = tmp_path / "config"
    config.mkdir()
    (config / "tls.yaml").write_text(settings.replace("/home/me/", f"{tmp_path}/"))
    environment = {"DASK_CONFIG": str(config)}
    with start_by_hand(tmp_path, 1, scheduler=("--protocol", "tls"), environment=environment) as (address, _):
        assert address.startswith("tls://")
        refused = pytest.raises(ClusterError, match=f"--scheduler {address}: TLS expects a `ssl_context`")
        with refused, cluster.connect(address, None, PATIENCE_S):
            pass
        with dask.config.set(dask.config.merge(dask.config.config, yaml.safe_load((config / "tls.yaml").read_text()))):
            with cluster.connect(address, None, PATIENCE_S) as client:
                dispatch(client, opened)
            plain = address.replace("tls", "tcp")
            with pytest.raises(ClusterError, match=f"--scheduler {plain}"), cluster.connect(plain, None, PATIENCE_S):
                pass
    assert list_cases(opened) == list(range(6))


def test_a_scheduler_that_is_stopped_or_ends_is_noticed(opened, by_hand, monkeypatch, capfd):
    """One that is stopped keeps its connections: nothing but its silence tells of it.

    One that ends is noticed at once, also before a batch has come in, although it had long to answer at first.
    """
    address, process = by_hand
    said = rf"the scheduler {address} has not answered for 3 s: it is stopped, .*: continue it, or start another one"
    with monkeypatch.context() as patch, cluster.connect(address, None, PATIENCE_S) as client:
        patch.setattr(cluster, "WATCH_S", 0.2)
        patch.setattr(cluster, "ANSWER_S", 1.0)
        with pytest.raises(ClusterError, match=said):
            dispatch(client, opened, lambda *_: process.send_signal(signal.SIGSTOP))
    assert 0 < len(list_cases(opened)) < 6
    process.send_signal(signal.SIGCONT)
    lost = pytest.raises(ClusterError, match=f"the scheduler {address} is lost")
    with cluster.connect(address, None, PATIENCE_S) as client:
        later = make_dispatcher(client, opened)
        assert later.find_dashboard().endswith("/status")
        with lost:
            dispatch(client, opened, lambda *_: end_with_children(process))
        stored = list_cases(opened)
        with lost:
            later.run(range(6), (), lambda *_: None)
    assert stored and list_cases(opened) == stored
    assert "Traceback" not in capfd.readouterr().err


def test_what_is_no_scheduler_is_said():
    """dask waits for ever for what it says first."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        said = f"--scheduler {address}: nothing has answered as a scheduler after 0.2 s"
        with pytest.raises(ClusterError, match=said), cluster.connect(address, None, 0.2):
            pass


def test_rows_that_are_lost_with_their_worker_are_computed_again(opened, monkeypatch):
    """The worker ends when its batch is done and has not been fetched; its nanny starts another one."""
    fetch, lost = cluster.Dispatcher._fetch, []

    def lose(dispatcher, future):
        if not lost:
            lost.append(future.status)
            for pid in client.run(os.getpid).values():
                psutil.Process(pid).kill()
            wait_until(lambda: future.status != "finished")
        return fetch(dispatcher, future)

    monkeypatch.setattr(cluster.Dispatcher, "_fetch", lose)
    with cluster.connect(None, 1) as client:
        dispatch(client, opened)
    assert lost == ["finished"]
    assert list_cases(opened) == list(range(6))


def test_what_goes_wrong_on_a_worker_is_no_loss_of_the_scheduler(opened, monkeypatch):
    """Nor a row, if workers end before they have a case."""
    monkeypatch.setattr(cluster, "ALLOWED_FAILURES", 0)
    monkeypatch.setattr(cluster, "keep", leave)
    with cluster.connect(None, 1) as client:
        dispatcher = make_dispatcher(client, opened)
        with pytest.raises(ClusterError, match="cases cannot be run there: ValueError: invalid literal"):
            dispatcher._fetch(client.submit(int, "x"))
        with pytest.raises(FileNotFoundError, match="/nowhere"):
            dispatcher._fetch(client.submit(os.listdir, "/nowhere"))
        with pytest.raises(ClusterError, match="workers end when they take over the files of the study"):
            dispatch(client, opened)
    assert list_cases(opened) == []


def test_a_cluster_that_does_not_start_is_said():
    with (
        dask.config.set({"temporary-directory": "/dev/null/x"}),
        pytest.raises(ClusterError, match="a cluster on this machine: "),
        cluster.connect(None, 1),
    ):
        pass


def test_cases_of_a_batch_that_kills_workers_run_one_by_one(opened, monkeypatch):
    def die(bundle, jobs, timeout_s, stored):  # of the worker itself, which no process for the cases prevents
        if any(index == 4 for index, _ in jobs):
            os._exit(1)
        return run_batch(bundle, jobs, timeout_s, stored)

    run_batch = cluster.run_batch
    monkeypatch.setattr(cluster, "run_batch", die)
    monkeypatch.setattr(cluster, "ALLOWED_FAILURES", 0)
    monkeypatch.setattr(cluster, "BATCHES_PER_THREAD", 1)
    seen = []
    with cluster.connect(None, 1) as client:
        dispatch(client, opened, lambda *found: seen.append(found))
    prepared, folder = opened
    statuses = RowStore(folder, prepared.identity.plan_sha256).read_statuses()
    assert statuses == {case: KILLED if case == 4 else DONE for case in range(6)}
    assert [sum(column) for column in zip(*seen, strict=True)] == [6, 1]
