"""What a study asks of a dask scheduler, and how it learns that there will be no answer."""

from __future__ import annotations

import asyncio
import concurrent.futures
import time
from collections.abc import Callable, Collection, Coroutine, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from typing import Any

from ..terminal import reason
from .rows import ClusterError, StartError, VersionError

WATCH_S = 1.0  # between looks at whether the scheduler is still there, and has workers at all
NO_WORKER_S = 60.0  # that workers may take to come, or to come back
ANSWER_S = 60.0  # that a connected scheduler may take to answer: its process may have been stopped for a while


class Scheduler:
    """The scheduler of a dask client.  All methods raise :class:`.rows.ClusterError` when it is lost.

    A client that has lost its scheduler goes on asking for as long as the scheduler had to answer at first
    (``--scheduler-timeout``).  Its status says at once that it is lost.
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self.address = client.scheduler.address
        """A client that has given up has none."""
        self._idle_since: float | None = None
        """Since when there has been no worker."""

    def submit(self, function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """The future of a call on a worker."""
        with self._notice_loss():
            return self._client.submit(function, *arguments, pure=False, **options)

    def wait(self, futures: Collection[Any]) -> Collection[Any]:
        """Those that have come in; none after a while without any."""
        from distributed import wait

        with self._notice_loss():
            try:
                with self._client.as_current():
                    arrived: Collection[Any] = wait(list(futures), WATCH_S, "FIRST_COMPLETED").done
                    return arrived
            except TimeoutError:
                return ()

    def fetch(self, future: Any) -> Any:
        """The result of a future; what has been lost with its worker is computed again.

        Raises what the task has raised, if that is ``KilledWorker`` or known to :func:`.worker.run_batch`.
        """
        from distributed.scheduler import KilledWorker

        try:
            with self._notice_loss(future):
                return self._finish(self._client.gather(future, asynchronous=True), self.count_threads)
        except (ClusterError, KilledWorker, StartError, VersionError, OSError):
            raise
        except Exception as error:
            text = " ".join(reason(error).split())
            raise ClusterError(f"cases cannot be run there: {type(error).__name__}: {text}") from error

    def count_threads(self) -> int:
        """Of all workers.  Raises :class:`.rows.ClusterError` if there have been no workers for long."""
        threads = sum(self._ask(lambda: self._client.nthreads(asynchronous=True)).values())
        if threads:
            self._idle_since = None
            return threads
        now = time.monotonic()
        if self._idle_since is None:
            self._idle_since = now
        if now - self._idle_since > NO_WORKER_S:
            raise ClusterError(f"the scheduler {self.address} has had no worker for {NO_WORKER_S:g} s")
        return 0

    def find_dashboard(self) -> str | None:
        """Address of dask's dashboard; None where bokeh, which draws it, is not installed.

        Of a scheduler elsewhere that is not known: the address may lead nowhere.
        """
        from distributed.comm.addressing import get_address_host
        from distributed.utils import format_dashboard_link

        if self._client.cluster is not None:
            return None if find_spec("bokeh") is None else str(self._client.cluster.dashboard_link)
        port = self._ask(lambda: self._client.scheduler.identity())["services"].get("dashboard")
        return None if port is None else str(format_dashboard_link(get_address_host(self.address), port))

    def cancel(self, futures: Collection[Any]) -> None:
        """Take tasks back.  A scheduler that is lost has none: what ended the study is said, not this."""
        with suppress(Exception):
            if self._client.status == "running":
                self._client.cancel(list(futures))

    def _ask(self, question: Callable[[], Coroutine[Any, Any, Any]]) -> Any:
        """What the scheduler answers."""
        end = time.monotonic() + ANSWER_S

        def watch() -> None:
            if time.monotonic() > end:
                raise ClusterError(f"the scheduler {self.address} has not answered for {ANSWER_S:g} s")

        with self._notice_loss():
            return self._finish(question(), watch)

    def _finish(self, coroutine: Coroutine[Any, Any, Any], watch: Callable[[], object]) -> Any:
        """What a coroutine of the client returns; ``watch`` is called now and then until it does."""
        answer = asyncio.run_coroutine_threadsafe(coroutine, self._client.loop.asyncio_loop)
        try:
            while not concurrent.futures.wait([answer], WATCH_S).done:
                self._check_connection()
                watch()
            return answer.result()
        finally:
            answer.cancel()

    def _check_connection(self) -> None:
        if self._client.status != "running":
            raise self._say_lost()

    def _say_lost(self) -> ClusterError:
        return ClusterError(f"the scheduler {self.address} is lost")

    @contextmanager
    def _notice_loss(self, task: Any = None) -> Iterator[None]:
        """Raise :class:`.rows.ClusterError` for whatever the body raises because the connection has ended.

        ``task``: future of a task that may have failed; what it has raised says nothing of the connection.
        """
        from distributed import CancelledError

        self._check_connection()
        try:
            yield
        except ClusterError:
            raise
        except Exception as error:
            failed = task is not None and task.status == "error"
            ended = isinstance(error, OSError | CancelledError | concurrent.futures.CancelledError)
            if not failed and (ended or self._client.status != "running"):  # a closed client has no scheduler to ask
                raise self._say_lost() from error
            raise
