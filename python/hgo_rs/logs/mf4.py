"""MDF, the measurement files of ASAM (.mf4, .mdf), by the library asammdf.

Columns are the channels in physical units, `channel` or `channel[i]`; `group/channel`, by the
number of the group, where several groups have a channel of this name. The clock of a group is
`group/time_s`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from hgo_rs.logs.recording import Recording, elements


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    from asammdf import MDF

    with MDF(path) as file:
        home: dict[str, tuple[int, int, int | None]] = {}
        clocks: dict[str, str | None] = {}
        for channel, places in file.channels_db.items():
            for group, index in places:
                if file.masters_db.get(group) == index:
                    clocks[f"{group}/time_s"] = f"{group}/time_s"
                    continue
                name = channel if len(places) == 1 else f"{group}/{channel}"
                first = file.get(group=group, index=index, record_count=1).samples
                columns: dict[str, int | None] = {name: None}
                if first.ndim == 2:
                    names = elements(name, first.shape[1])
                    columns = {place: i for i, place in enumerate(names)}
                for column, i in columns.items():
                    home[column] = group, index, i
                    clocks[column] = f"{group}/time_s" if group in file.masters_db else None

        def load(names: list[str]) -> dict[str, np.ndarray]:
            columns = {}
            for name in names:
                if name not in home:
                    columns[name] = file.get_master(int(name.split("/", 1)[0]))
                    continue
                group, index, i = home[name]
                signal = file.get(group=group, index=index)
                values = signal.samples if i is None else signal.samples[:, i]
                every = file.get_master(group)
                if len(values) < len(every):  # samples that are marked invalid are left out
                    there = np.isin(every, signal.timestamps)
                    padded = np.full(len(every), np.nan)
                    padded[there] = values
                    values = padded
                columns[name] = values
            return columns

        yield Recording(clocks, load)
