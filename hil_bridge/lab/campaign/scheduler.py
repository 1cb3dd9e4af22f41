"""Workers on other machines, through a Dask scheduler."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.lab.processes import Workers

CONNECT_S = 10.0
"""Timeout for an answer of the scheduler, s. Chosen."""
WORKERS_S = 60.0
"""Timeout for the first worker of the scheduler, s. Chosen."""


@contextmanager
def dask_workers(url: str) -> Iterator[Workers]:
    """Provide the workers of a scheduler such as tcp://host:8786. Workers may come and go; another worker takes
    over the jobs of a lost one.

    Raises ConfigError if the package is not installed or the scheduler does not answer, and BridgeError if a worker
    fails.
    """
    try:
        import distributed
    except ImportError as error:
        raise ConfigError(
            f"--scheduler needs the package distributed; {install_command('dask')} here and where the workers are"
        ) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # errors are reported below, in one line
    try:
        client: Any = distributed.Client(url, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ConfigError(
            f"--scheduler {url}: no scheduler answers; start one with `dask scheduler`"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=WORKERS_S)
        except TimeoutError as error:
            raise ConfigError(
                f"--scheduler {url}: the scheduler has no worker; start one with `dask worker {url} --nthreads 1`"
            ) from error
        # Dask retries a job after each lost worker, but gives up on one that keeps killing its workers.
        with client.get_executor(pure=False) as executor:
            try:
                yield Workers(executor, lambda: sum(client.nthreads().values()))
            except Exception as error:
                executor.shutdown(wait=False)
                if isinstance(error, BridgeError):
                    raise
                raise BridgeError(
                    f"--scheduler {url}: {type(error).__name__}: {_first_line(error)}"
                ) from error
            except BaseException:  # Ctrl-C: cancel the submitted jobs
                executor.shutdown(wait=False)
                raise


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or ["no reason given"])[0]
