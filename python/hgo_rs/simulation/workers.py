"""Worker processes that end with the process which they work for."""

from __future__ import annotations

import multiprocessing
import os
import threading
from multiprocessing.connection import wait

_LOCK = threading.Lock()
_followed: set[int] = set()


def end_with_parent(home: int | None = None) -> None:
    """Let this worker process end when its parent does, even if a signal kills the parent.

    A worker of `multiprocessing` waits for its next task for ever: a parent that a signal kills
    tells it nothing. `home`: only if this is the process id of the parent;
    without effect in a process that is no worker.
    """
    parent = multiprocessing.parent_process()
    if parent is None or parent.pid is None or home not in (None, parent.pid):
        return
    with _LOCK:
        if parent.pid in _followed:
            return
        _followed.add(parent.pid)

    def follow() -> None:
        wait([parent.sentinel])
        os._exit(1)  # the main thread may be in the core, or wait for a task

    threading.Thread(target=follow, name="hgo-end-with-parent", daemon=True).start()
