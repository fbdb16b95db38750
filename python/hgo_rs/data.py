"""The earlier name of `hgo_rs.logs`, for programs that import it."""

from hgo_rs.logs import Log, read_log

__all__ = ["Log", "read_log"]
