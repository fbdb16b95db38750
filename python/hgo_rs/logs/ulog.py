"""ULog, the flight logs of PX4, by the library pyulog.

Columns are `topic/field`, `topic/field[i]`, and `topic.1/field` of a topic's second instance; the
clock of a topic is its `topic/timestamp`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from hgo_rs.logs.recording import Recording

_TIMES = ("timestamp", "timestamp_sample")
"""Fields in us since the start of the flight controller."""


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    from pyulog import ULog

    log = ULog(str(path))
    columns: dict[str, np.ndarray] = {}
    clocks: dict[str, str | None] = {}
    for topic in log.data_list:
        name = f"{topic.name}.{topic.multi_id}" if topic.multi_id else topic.name
        for field, values in topic.data.items():
            column = f"{name}/{field}"
            times = field in _TIMES
            columns[column] = values.astype("timedelta64[us]") if times else values
            clocks[column] = f"{name}/timestamp"
    remarks = []
    if log.file_corruption:
        remarks.append(f"{path.name} is damaged: some of its messages could not be read")
    if cut := _cut_off(path):
        remarks.append(f"{path.name} is cut off: the last {cut} bytes are a part of a message")

    def load(names: list[str]) -> dict[str, np.ndarray]:
        return {name: columns[name] for name in names}

    yield Recording(clocks, load, tuple(remarks))


def _cut_off(path: Path) -> int:
    """Bytes of a last message that is not whole.

    A message is the size of its content (2 bytes), its type (1 byte), its content.
    """
    data = path.read_bytes()
    at = 16
    while at + 3 <= len(data):
        end = at + 3 + int.from_bytes(data[at : at + 2], "little")
        if end > len(data):
            break
        at = end
    return len(data) - at
