"""Batches of cases on dask.distributed: a bounded number in flight, isolation of what kills workers."""

from __future__ import annotations

import asyncio
import concurrent.futures
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Coroutine, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from logging import CRITICAL
from pathlib import Path
from typing import Any

from ..child_processes import ONE_THREAD
from ..terminal import block_interrupts, hold_interrupts, reason
from .bundle import Bundle, check_versions, clean_versions, result_versions
from .plan import Plan
from .rows import (
    DONE,
    KILLED,
    SIGNALS,
    ClusterError,
    RowStore,
    StartError,
    VersionError,
    name_file,
    write_durably,
)
from .worker import Done, keep, run_batch

BATCH_S = 10.0
"""Wanted time of a batch: much longer than dask's overhead of some 10 ms, short enough that little is lost."""
BATCHES_PER_THREAD = 2  # in flight: one runs, one waits at the worker
MOST_IN_BATCH = 200
CONNECT_S = 10.0
"""That a scheduler may take to answer: it is asked again until then, so that it may be started at the same time."""
WATCH_S = 1.0  # between looks at the scheduler and its workers
ANSWER_S = 2.0  # that a scheduler may take to say which workers it has; else what it said before holds
UNANSWERED = 3
"""Looks in a row without an answer after which a scheduler is given up: it took WATCH_S + ANSWER_S for each."""
SILENT_S = 6.0  # after which a worker is given up that the scheduler has not heard of; it should at least each 2 s
RESTART_S = 5.0  # that a nanny may take to end such a worker: it is asked to end before it is killed
NO_WORKER_S = 60.0  # that workers may take to come, or to come back
CLOSE_S = 60.0  # that a cluster may take to close: workers that are stopped do not answer
MEMORY_SHARE = 0.9  # of this machine, for the workers of a cluster on it and their cases
ALLOWED_FAILURES = 20
"""Deaths of workers that a batch may see; with dask's 3 a few random ones would break innocent batches."""

_BOUNDED = {
    "distributed.worker.profile.enabled": False,  # 15 kB a second in each worker, and nobody looks at it
    "distributed.admin.log-length": 1000,
    # Of each kind of event, of transitions, and of messages to the scheduler and to each worker: those with batches are
    # some 50 kB each, and the command has them all.
    "distributed.admin.low-level-log-length": 5,
    "distributed.admin.system-monitor.log-length": 600,  # half-seconds
}
"""What dask keeps of the past: its processes stop growing after minutes instead of hours."""


@contextmanager
def connect(address: str | None, workers: int | None, timeout_s: float = CONNECT_S) -> Iterator[Any]:
    """A dask client: of the scheduler at ``address``, or of a new cluster on this machine, for the body.

    ``workers``: how many on this machine; None: one for each processor.  ``timeout_s``: that a scheduler at an address
    may take to answer.  Raises :class:`.rows.ClusterError`.
    """
    try:
        import dask
        from distributed import Client
        from distributed.comm.addressing import get_address_host_port
        from distributed.utils import silence_logging_cmgr
    except ImportError as error:
        raise ClusterError("a study needs dask: pip install 'ps-fmu[sweep]'") from error
    settings = _BOUNDED | {
        "distributed.scheduler.allowed-failures": ALLOWED_FAILURES,
        "distributed.nanny.pre-spawn-environ": {**dask.config.get("distributed.nanny.pre-spawn-environ", {}),
                                                **ONE_THREAD},
        "distributed.admin.large-graph-warning-threshold": "100MB",  # the FMUs travel as a task
    }  # fmt: skip
    # A client tells of a lost scheduler by tracebacks; what it means for the study is said in a line.
    with dask.config.set(settings), silence_logging_cmgr(CRITICAL), ExitStack() as stack:
        try:
            if address is None:
                client = Client(_start_cluster(workers, stack), set_as_default=False)
            else:
                get_address_host_port(address)  # a client asks for what is no address again, and ends with a traceback
                asyncio.run(asyncio.wait_for(_ask(address), timeout_s))
                client = Client(address, set_as_default=False, timeout=timeout_s)
            stack.callback(_close, client, ANSWER_S)
        except Exception as error:  # no scheduler there, it did not answer, no address; workers that do not start
            where = "a cluster on this machine" if address is None else f"--scheduler {address}"
            problem = str(error) or f"nothing has answered as a scheduler after {timeout_s:g} s"
            raise ClusterError(f"{where}: {problem}") from error
        yield client


async def _ask(address: str) -> None:
    """Have a scheduler answer.  A client waits for ever for a process that is stopped, or that is no scheduler."""
    from distributed.core import rpc
    from distributed.security import Security

    async with rpc(address, connection_args=Security().get_connection_args("client")) as scheduler:
        await scheduler.identity()


def _start_cluster(workers: int | None, stack: ExitStack) -> Any:
    """A cluster on this machine, which ``stack`` closes; it is said how much memory its workers may have."""
    from dask.system import CPU_COUNT
    from distributed import LocalCluster
    from distributed.system import MEMORY_LIMIT
    from distributed.utils import LoopRunner

    workers = workers or CPU_COUNT
    memory_bytes = int(MEMORY_SHARE * MEMORY_LIMIT / workers)
    _say(f"workers on this machine: {workers}; each may take {memory_bytes / 1e9:.3g} GB of memory with its case")

    # Its processes are started by python -c, which would import modules of the current directory before its own.  They
    # inherit this from here, and dask sets more here: all of it ends with the cluster.
    stack.callback(_restore_environment, dict(os.environ))
    os.environ["PYTHONSAFEPATH"] = "1"
    loop = LoopRunner()  # its thread starts the workers, also those that take the place of others
    with block_interrupts():  # a terminal sends Ctrl-C to all processes: workers would end with tracebacks
        loop.start()
    stack.callback(loop.stop)
    with hold_interrupts():
        cluster = LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0",
            silence_logs=CRITICAL, loop=loop.loop, memory_limit=memory_bytes,
        )  # fmt: skip
        stack.callback(_close, cluster, CLOSE_S)
    return cluster


def _restore_environment(before: Mapping[str, str]) -> None:
    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)


def _close(opened: Any, limit_s: float) -> None:
    """Close a client or a cluster: what there is to say of the study, and of the cluster, has been said before."""
    with hold_interrupts(), suppress(Exception):
        opened.close(limit_s)


def _say(text: str) -> None:
    """A line on the error stream, above the progress bar."""
    from tqdm import tqdm

    tqdm.write(text, file=sys.stderr)


def _name(address: str, worker: Mapping[str, Any]) -> str:
    """A worker as messages call it, as its scheduler describes it."""
    return f"worker {address}" if worker["name"] == address else f"worker {worker['name']} ({address})"


class Silences:
    """How long the workers of a scheduler have not been heard of.

    Their clocks, and that of the scheduler, may differ from this one: what counts is whether the time changes at which
    the scheduler has heard of a worker, and the time between looks.  A long one may be that of a command that was
    stopped itself.
    """

    def __init__(self) -> None:
        self._looked = time.monotonic()
        self._known: dict[str, tuple[float, float]] = {}
        """By address: when the scheduler has heard of it, on its clock; for how long that has not changed."""

    def find(self, workers: Mapping[str, Mapping[str, Any]]) -> set[str]:
        """Addresses of those that are silent for too long, of ``workers`` as the scheduler describes them."""
        from distributed.scheduler import heartbeat_interval

        now = time.monotonic()
        passed, self._looked = min(now - self._looked, WATCH_S + ANSWER_S), now
        before, self._known = self._known, {}
        for address, worker in workers.items():
            heard, silent = before.get(address, (None, 0.0))
            self._known[address] = worker["last_seen"], silent + passed if heard == worker["last_seen"] else 0.0
        most = max(SILENT_S, 3.0 * heartbeat_interval(len(workers)))
        return {address for address, (_, silent) in self._known.items() if silent > most}


class Dispatcher:
    """Sends the missing cases of a plan to the workers of a client until all have rows.

    All methods raise :class:`.rows.ClusterError` when the scheduler is lost.
    """

    def __init__(self, client: Any, plan: Plan, plan_hash: str, bundle: Bundle, output: Path) -> None:
        self._client, self._address = client, client.scheduler.address  # a client that has given up has none
        self._plan, self._files = plan, bundle
        self._bundle: Any = None
        self._output, self._store = output, RowStore(output, plan_hash)
        self._stored: frozenset[int] = frozenset()
        self._finished, self._spent_s = 0, 0.0
        self._threads = 0
        self._next_look, self._unanswered = 0.0, 0
        self._silences = Silences()
        self._given_up, self._checked = set[str](), set[str]()
        """Addresses of workers: of those that are not heard of, and of those that have the right packages."""
        self._idle_since: float | None = None
        """Since when there has been no worker."""
        self._idle_said = False

    def find_dashboard(self) -> str | None:
        """Address of dask's dashboard; None where bokeh, which draws it, is not installed.

        Of a scheduler elsewhere that is not known: the address may lead nowhere.
        """
        if self._client.cluster is not None and find_spec("bokeh") is None:
            return None
        with self._notice_loss(), suppress(KeyError):  # a scheduler without a dashboard has no port of one
            return str(self._client.dashboard_link)
        return None

    def run(self, cases: Sequence[int], stored: Collection[int], report: Callable[[int, int], None]) -> None:
        """Run these cases, ascending; ``stored`` are those of them whose signals are stored.

        ``report`` is called after each batch with the number of cases that it had, and how many of these are not done.

        Raises what :func:`.worker.run_batch` raises, too.
        """
        self._stored = frozenset(stored)
        while not self._count_threads():  # none gets anything before it is known to have ps_fmu
            time.sleep(WATCH_S)
        key = f"ps-fmu-study-{self._files.sha256}"
        with self._notice_loss():
            self._bundle = self._client.submit(keep, self._files, key=key, pure=False)
        suspects = self._run(cases, report)
        # One by one, with nothing beside it: dask suspects all that a dying worker had.
        for case, error in self._run(list(suspects), report, alone=True).items():
            text = f"its workers ended as often as the scheduler allows: {error}"
            self._keep(Done([{"case": case, "status": KILLED, "error": text}], {}), report)

    def _run(
        self, cases: Sequence[int], report: Callable[[int, int], None], *, alone: bool = False
    ) -> dict[int, Exception]:
        """Run cases; the errors of those whose workers have ended again and again, by case."""
        from distributed.scheduler import KilledWorker

        todo, flights, killed = deque(cases), dict[Any, list[int]](), dict[int, Exception]()
        try:
            while todo or flights:
                threads = max(1, self._count_threads())
                while todo and len(flights) < (1 if alone else BATCHES_PER_THREAD * threads):
                    batch = [todo.popleft()] if alone else self._take(todo, threads)
                    flights[self._submit(batch)] = batch
                for future in self._wait(flights):
                    batch = flights.pop(future)
                    try:
                        self._keep(self._fetch(future), report)
                    except KilledWorker as error:
                        if error.task == self._bundle.key:
                            problem = f"workers end when they take over the files of the study: {error}"
                            raise ClusterError(problem) from error
                        killed |= dict.fromkeys(batch, error)
                    future.release()
        finally:
            with suppress(Exception):  # a scheduler that is lost has none: what ended the study is said, not this
                if self._client.status == "running":
                    self._client.cancel(list(flights))
        return killed

    def _take(self, todo: deque[int], threads: int) -> list[int]:
        """Cases from the queue: some ten seconds' worth, and fewer when it ends, so that all workers have some.

        One whose signals are stored is by itself: they are large.
        """
        each = self._spent_s / self._finished if self._finished else BATCH_S
        share = -(-len(todo) // (BATCHES_PER_THREAD * threads))
        most = max(1, min(MOST_IN_BATCH, round(BATCH_S / max(each, 1e-3)), share))
        cases = [todo.popleft()]
        while todo and len(cases) < most and not self._stored.intersection((cases[0], todo[0])):
            cases.append(todo.popleft())
        return cases

    def _submit(self, cases: Sequence[int]) -> Any:
        jobs = [(index, self._plan.values(index)) for index in cases]
        stored = [index for index in cases if index in self._stored]
        with self._notice_loss():
            return self._client.submit(run_batch, self._bundle, jobs, self._plan.study.timeout_s, stored, pure=False)

    def _wait(self, futures: Collection[Any]) -> Collection[Any]:
        """Those that have come in; none after a while without any."""
        from distributed import wait

        with self._notice_loss(), suppress(TimeoutError), self._client.as_current():
            arrived: Collection[Any] = wait(list(futures), WATCH_S, "FIRST_COMPLETED").done
            return arrived
        return ()

    def _fetch(self, future: Any) -> Done:
        """What a batch has found; what has been lost with its worker is computed again."""
        from distributed.scheduler import KilledWorker

        gathered = self._begin(self._client.gather(future, asynchronous=True))
        try:
            while not concurrent.futures.wait([gathered], WATCH_S).done:
                self._count_threads()
            found: Done = gathered.result()
            return found
        except (KilledWorker, StartError, VersionError, ClusterError):
            raise
        except Exception as error:
            failed = future.status == "error"  # else it is no error of the batch
            if not failed and self._is_lost(error):
                raise self._say_lost() from error
            if failed and isinstance(error, OSError):
                raise
            text = " ".join(reason(error).split())
            raise ClusterError(f"cases cannot be run there: {type(error).__name__}: {text}") from error
        finally:
            gathered.cancel()

    def _begin(self, work: Coroutine[Any, Any, Any]) -> concurrent.futures.Future[Any]:
        """Have the client do something in its own thread."""
        return asyncio.run_coroutine_threadsafe(work, self._client.loop.asyncio_loop)

    def _count_threads(self) -> int:
        """Of all workers that are heard of; those that are not are given up.

        Raises :class:`.rows.ClusterError` if there have been no workers for long, or the scheduler does not answer, and
        :class:`.rows.VersionError`.
        """
        if time.monotonic() < self._next_look:
            return self._threads
        # Without a limit a client asks a scheduler that has just ended for as long as one may take to answer.
        with self._notice_loss(), suppress(TimeoutError):
            self._unanswered += 1
            workers = self._client.sync(self._client.scheduler.identity, callback_timeout=ANSWER_S)["workers"]
            self._unanswered = 0
            for address in self._silences.find(workers) - self._given_up:
                self._give_up(address, _name(address, workers[address]))
            heard = {address: worker for address, worker in workers.items() if address not in self._given_up}
            self._threads = sum(worker["nthreads"] for worker in heard.values())
            self._check_versions(heard)
        if self._unanswered >= UNANSWERED:
            raise ClusterError(
                f"the scheduler {self._address} has not answered for {UNANSWERED * ANSWER_S:g} s: it is stopped, or "
                "its machine or the network is down or overloaded: continue it, or start another one"
            )
        now = time.monotonic()
        self._next_look = now + WATCH_S
        self._idle_since = None if self._threads else self._idle_since or now
        idle_s = 0.0 if self._idle_since is None else now - self._idle_since
        if idle_s < SILENT_S:
            self._idle_said = False
        elif not self._idle_said:
            self._idle_said = True
            _say(f"the scheduler {self._address} has no worker: the study ends if none comes within {NO_WORKER_S:g} s")
        if idle_s > NO_WORKER_S:
            raise ClusterError(
                f"the scheduler {self._address} has had no worker for {NO_WORKER_S:g} s: start some, or see "
                "in their logs why they have ended"
            )
        return self._threads

    def _check_versions(self, workers: Mapping[str, Mapping[str, Any]]) -> None:
        """Ask workers that were not there before for their packages: one without ps_fmu would end by the first batch.

        Raises :class:`.rows.VersionError`.
        """
        expected = result_versions()
        question = {"op": "versions", "packages": [name for name in expected if name != "python"]}
        if new := workers.keys() - self._checked:
            found = self._client.sync(
                self._client.scheduler.broadcast, msg=question, workers=list(new), on_error="ignore",
                callback_timeout=ANSWER_S,
            )  # fmt: skip
            for address, about in found.items():
                check_versions(expected, clean_versions(about["packages"]), _name(address, workers[address]))
                self._checked.add(address)

    def _give_up(self, address: str, name: str) -> None:
        """Have the scheduler take a worker away, and its cases run elsewhere."""
        self._given_up.add(address)
        _say(
            f"{name} has not been heard of for {SILENT_S:g} s: it is stopped, or its machine or the "
            "network is down or overloaded.  Its cases run again elsewhere; where it has a nanny it is started anew"
        )
        ending = self._client.scheduler.restart_workers(
            workers=[address], timeout=RESTART_S, wait_for_workers=False, on_error="return",
            stimulus_id="ps-fmu-worker-not-heard-of",
        )  # fmt: skip
        self._begin(ending)

    @contextmanager
    def _notice_loss(self) -> Iterator[None]:
        """Raise :class:`.rows.ClusterError` for whatever the body raises because the connection has ended."""
        if self._is_lost(None):
            raise self._say_lost()
        try:
            yield
        except Exception as error:
            if self._is_lost(error):
                raise self._say_lost() from error
            raise

    def _is_lost(self, error: Exception | None) -> bool:
        """Whether there is no scheduler: its client says so at once, and cancels its futures."""
        from distributed import CancelledError

        ended = isinstance(error, OSError | CancelledError | concurrent.futures.CancelledError)
        return ended or self._client.status != "running"

    def _say_lost(self) -> ClusterError:
        return ClusterError(f"the scheduler {self._address} is lost")

    def _keep(self, done: Done, report: Callable[[int, int], None]) -> None:
        for case, content in done.signals.items():  # before the row, which says that a case is done
            write_durably(self._output / SIGNALS / name_file(case), content)
        self._store.add(done.rows)
        self._finished += len(done.rows)
        self._spent_s += sum(row.get("wall_s", 0.0) for row in done.rows)
        report(len(done.rows), sum(row["status"] != DONE for row in done.rows))
