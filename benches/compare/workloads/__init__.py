"""One file a workload, its implementations side by side."""

from __future__ import annotations

from compare.harness import Workload
from compare.workloads import (
    astolfi_vertices,
    build,
    fu_mc,
    import_time,
    katayama_ship,
    lee_mc,
    loop_mc,
    online_step,
    record_1e6,
    sanfelice_praly_mc,
)

WORKLOADS: tuple[Workload, ...] = (
    *lee_mc.WORKLOADS,
    fu_mc.WORKLOAD,
    astolfi_vertices.WORKLOAD,
    sanfelice_praly_mc.WORKLOAD,
    katayama_ship.WORKLOAD,
    loop_mc.WORKLOAD,
    *record_1e6.WORKLOADS,
    online_step.WORKLOAD,
    import_time.WORKLOAD,
    build.WORKLOAD,
)
