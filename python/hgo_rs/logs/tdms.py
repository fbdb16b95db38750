"""TDMS, the measurement files of LabVIEW, by the library npTDMS.

Columns are `group/channel`. A waveform has its clock, `group/channel/time_s`: seconds since the
earliest start of a waveform of the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.logs.recording import Recording


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    from nptdms import TdmsFile

    with TdmsFile.open(path) as file:
        channels: dict[str, Any] = {}
        times: dict[str, Any] = {}
        clocks: dict[str, str | None] = {}
        for group in file.groups():
            for channel in group.channels():
                name = f"{group.name}/{channel.name}"
                channels[name], clocks[name] = channel, None
                if channel.properties.get("wf_increment"):
                    clocks[name] = f"{name}/time_s"
                    times[f"{name}/time_s"] = channel
        clocks |= {name: name for name in times}
        starts = [c.properties.get("wf_start_time") for c in times.values()]
        origin = min((start for start in starts if start is not None), default=None)

        def load(names: list[str]) -> dict[str, np.ndarray]:
            columns = {}
            for name in names:
                if name in times:
                    track = times[name].time_track()
                    start = times[name].properties.get("wf_start_time")
                    if start is not None:
                        track = track + (start - origin) / np.timedelta64(1, "s")
                    columns[name] = track
                else:
                    columns[name] = channels[name][:]
            return columns

        cut = file.file_status.incomplete_final_segment
        remarks = (f"{path.name} is cut off: its last segment is not whole",) if cut else ()
        yield Recording(clocks, load, remarks)
