"""Studies: many runs of many cases as one.

`cases` turns parameters into experiments, `pieces` computes them here or by an executor, `saved`
keeps what is finished in a file, `result` is what a study gives, `run` ties them together.
"""

from __future__ import annotations

from hgo_rs.simulation.studies.progress import StudyProgress
from hgo_rs.simulation.studies.result import StudyError, StudyInterrupted, StudyResult
from hgo_rs.simulation.studies.run import study

__all__ = ["StudyError", "StudyInterrupted", "StudyProgress", "StudyResult", "study"]
