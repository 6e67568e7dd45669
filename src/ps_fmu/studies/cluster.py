"""Batches of cases on dask.distributed: a bounded number in flight, isolation of what kills workers."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from logging import CRITICAL
from pathlib import Path
from threading import Thread
from typing import Any

from ..child_processes import ONE_THREAD
from ..terminal import block_interrupts, hold_interrupts
from .bundle import Bundle
from .parts import write_durably, write_part
from .plan import Plan
from .rows import KILLED, ClusterError
from .scheduler import Scheduler
from .signals import FOLDER, name_file
from .worker import Done, Order, keep, run_batch

BATCH_S = 10.0
"""Wanted time of a batch: much longer than dask's overhead of some 10 ms, short enough that little is lost."""
BATCHES_PER_THREAD = 2  # in flight: one runs, one waits at the worker
MOST_IN_BATCH = 200
CONNECT_S = 10.0
"""That a scheduler may take to answer: it is asked again until then, so that it may be started at the same time."""
CONNECTING = "connecting"  # name of the thread that does
SLACK_S = 2.0  # beyond CONNECT_S: where dask notices that there is no scheduler, it says why
CLOSE_S = 60.0  # that a connection or a cluster may take to close: processes that are stopped do not answer
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
                client = _connect_within(address, timeout_s)
            stack.callback(_close, client)
        except Exception as error:  # no scheduler there, it did not answer, no address; workers that do not start
            where = "a cluster on this machine" if address is None else f"--scheduler {address}"
            raise ClusterError(f"{where}: {str(error) or type(error).__name__}") from error
        yield client


def _connect_within(address: str, timeout_s: float) -> Any:
    """A client of a scheduler; ``OSError`` if there is none.

    dask itself waits for ever for the first words of a process that is stopped, and of one that is no scheduler.
    """
    from distributed import Client

    client = Client.__new__(Client)
    found: Future[None] = Future()

    def connect() -> None:
        try:
            Client.__init__(client, address, set_as_default=False, timeout=timeout_s)
        except Exception as error:
            found.set_exception(error)
        else:
            found.set_result(None)

    Thread(target=connect, name=CONNECTING, daemon=True).start()
    try:
        if not wait([found], timeout_s + SLACK_S).done:
            raise OSError(f"there is something, but it has not answered as a scheduler after {timeout_s:g} s")
        found.result()
    except BaseException:
        client.status = "closed"  # one that is connecting would keep Python from ending
        raise
    return client


def _start_cluster(workers: int | None, stack: ExitStack) -> Any:
    """A cluster on this machine, which ``stack`` closes."""
    from distributed import LocalCluster
    from distributed.utils import LoopRunner

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
            silence_logs=CRITICAL, loop=loop.loop,
        )  # fmt: skip
        stack.callback(_close, cluster)
    return cluster


def _restore_environment(before: Mapping[str, str]) -> None:
    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)


def _close(opened: Any) -> None:
    """Close a client or a cluster: what there is to say of the study, and of the cluster, has been said before."""
    with hold_interrupts(), suppress(Exception):
        opened.close(CLOSE_S)


class Dispatcher:
    """Sends the missing cases of a plan to the workers of a client until all have rows.

    Parameters
    ----------
    report: called after each batch with the number of cases that it had, and how many of these are not done.
    """

    def __init__(
        self, client: Any, plan: Plan, plan_hash: str, bundle: Bundle, output: Path, report: Callable[[int, int], None]
    ) -> None:
        self._scheduler, self._plan, self._hash = Scheduler(client), plan, plan_hash
        self._output, self._report = output, report
        self._order = Order(str(output), plan_hash, plan.study.timeout_s)
        self._bundle = self._scheduler.submit(keep, bundle, key=f"ps-fmu-study-{bundle.sha256}")
        self._todo: deque[int] = deque()
        self._stored: frozenset[int] = frozenset()
        self._suspects: deque[list[int]] = deque()
        """Halves of batches whose workers have died again and again.  Each runs with nothing beside it: dask suspects
        all that a dying worker had."""
        self._alone = False
        self._flights: dict[Any, list[int]] = {}
        self._finished, self._spent_s = 0, 0.0

    def run(self, cases: Sequence[int], stored: Collection[int] = ()) -> None:
        """Run these cases, ascending; ``stored`` are those of them whose signals are stored.

        Raises :class:`.rows.ClusterError`, and what :func:`.worker.run_batch` raises.
        """
        self._todo.extend(cases)
        self._stored = frozenset(stored)
        try:
            self._fill()
            while self._flights:
                arrived = self._scheduler.wait(self._flights)
                for future in arrived:
                    self._land(future, self._flights.pop(future))
                    future.release()
                self._alone = self._alone and bool(self._flights)
                self._fill()
        finally:
            self._scheduler.cancel(self._flights)

    def _fill(self) -> None:
        threads = max(1, self._scheduler.count_threads())
        most = 1 if self._suspects or self._alone else BATCHES_PER_THREAD * threads
        while len(self._flights) < most and (self._suspects or self._todo):
            self._alone = bool(self._suspects)
            cases = self._suspects.popleft() if self._suspects else self._take(threads)
            jobs = [(index, self._plan.values(index)) for index in cases]
            order = replace(self._order, stored=tuple(index for index in cases if index in self._stored))
            future = self._scheduler.submit(run_batch, self._bundle, jobs, order)
            self._flights[future] = cases

    def _take(self, threads: int) -> list[int]:
        """Neighbours from the queue: some ten seconds' worth, and fewer when it ends, so that all workers have some."""
        each = self._spent_s / self._finished if self._finished else BATCH_S
        share = -(-len(self._todo) // (BATCHES_PER_THREAD * threads))
        most = max(1, min(MOST_IN_BATCH, round(BATCH_S / max(each, 1e-3)), share))
        cases = [self._todo.popleft()]
        while self._todo and len(cases) < most and self._todo[0] == cases[-1] + 1:
            cases.append(self._todo.popleft())
        return cases

    def _land(self, future: Any, cases: list[int]) -> None:
        from distributed.scheduler import KilledWorker

        try:
            done: Done = self._scheduler.fetch(future)
        except KilledWorker as error:
            if error.task == self._bundle.key:
                raise ClusterError(f"workers end when they take over the files of the study: {error}") from error
            self._isolate(cases, error)
        else:
            self._keep(done, cases)

    def _keep(self, done: Done, cases: list[int]) -> None:
        for case, content in done.signals.items():  # before the part, which says that a case is done
            write_durably(self._output / FOLDER / name_file(case), content)
        if done.content is not None:
            write_part(self._output, self._hash, [{"case": cases[0]}, {"case": cases[-1]}], done.content)
        self._finished += done.cases
        self._spent_s += done.wall_s
        self._report(done.cases, done.not_done)

    def _isolate(self, cases: list[int], error: Any) -> None:
        """Bisection: of a batch that its workers did not survive, each half by itself."""
        if len(cases) > 1:
            middle = len(cases) // 2
            self._suspects.extend((cases[:middle], cases[middle:]))
            return
        text = f"its workers ended as often as the scheduler allows: {error}"
        write_part(self._output, self._hash, [{"case": cases[0], "status": KILLED, "error": text}])
        self._report(1, 1)
